model Pendulum "A motor that turns a pendulum"
  parameter Real J(unit = "kg.m2") = 0.5 "moment of inertia";
  parameter Real c(unit = "N.m") = 1.0 "largest torque of gravity";
  input Real tau1(unit = "N.m");
  output Real q1(unit = "rad");
  output Real dq1(unit = "rad/s");
protected
  Real x(start = 0, fixed = true);
  Real v(start = 0, fixed = true);
equation
  der(x) = v;
  J*der(v) = tau1 - c*sin(x);
  q1 = x;
  dq1 = v;
end Pendulum;
