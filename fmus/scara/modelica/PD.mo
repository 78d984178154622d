model PD "Proportional-derivative control of two joints, velocities measured; sampling is the master's"
  parameter Real Kp1 = 3700 "proportional gain";
  parameter Real Kp2 = 62 "proportional gain";
  parameter Real Kd1 = 230 "derivative gain";
  parameter Real Kd2 = 4 "derivative gain";
  input Real q_ref1(unit = "rad");
  input Real q_ref2(unit = "rad");
  input Real dq_ref1(unit = "rad/s");
  input Real dq_ref2(unit = "rad/s");
  input Real q1(unit = "rad");
  input Real q2(unit = "rad");
  input Real dq1(unit = "rad/s");
  input Real dq2(unit = "rad/s");
  output Real command1(unit = "N.m");
  output Real command2(unit = "N.m");
equation
  command1 = Kp1*(q_ref1 - q1) + Kd1*(dq_ref1 - dq1);
  command2 = Kp2*(q_ref2 - q2) + Kd2*(dq_ref2 - dq2);
end PD;
