model PD "Proportional-derivative control"
  parameter Real Kp = 20;
  parameter Real Kd = 4;
  input Real q_ref1(unit = "rad");
  input Real dq_ref1(unit = "rad/s");
  input Real q1(unit = "rad");
  input Real dq1(unit = "rad/s");
  output Real command1(unit = "N.m");
equation
  command1 = Kp*(q_ref1 - q1) + Kd*(dq_ref1 - dq1);
end PD;
