% Arm, ten targets, stop, and what is refused: octave-cli drive.m URI
robot = ccr.Client(argv(){1});
printf('firmware %d.%d.%d\n', robot.identity.firmware_version);
refused = '';
try
  robot.target([1 1]);
catch err
  refused = err.message;
end
printf('before arming: %s\n', refused);
robot.configure();
robot.arm();
for number = 1:10
  q_deg = [number, -2 * number];
  assert(robot.target(q_deg, 0.05, 10), q_deg, 1e-9);   % valid for longer than a busy machine stops us
  pause(0.06);
end
report = robot.state();
printf('setpoint %g %g, pulses %g %g, %s\n', report.setpoint_cdeg / 100, report.pulse_half_us / 2, report.state_name);
printf('clamped to %g %g\n', robot.target([170 0]));
robot.stop();
pause(0.1);   % the frame of the servos ends first
report = robot.state();
printf('%s, pulses %g %g\n', report.state_name, report.pulse_half_us / 2);
robot.clear_fault();
robot.arm();
robot.disarm();
printf('%s\n', robot.state().state_name);
robot.close();
