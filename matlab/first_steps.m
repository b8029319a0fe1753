% First steps on an emulated board (ccr-host emulate --tcp 127.0.0.1:5025); set uri for another one.
if ~exist('uri', 'var')
  uri = 'tcp://127.0.0.1:5025';
end
robot = ccr.Client(uri);
robot.configure();
robot.arm();
for k = 0:20
  q_deg = 20 * [sin(k / 5), 1 - cos(k / 5)];
  robot.target(q_deg, 0.05);
  pause(0.05);
end
report = robot.state();
fprintf('%s at %.1f and %.1f deg, where the model has the tip at [%.1f %.1f %.1f] mm\n', ...
  report.state_name, report.setpoint_cdeg / 100, ccr.tip(deg2rad(report.setpoint_cdeg / 100)));
robot.disarm();
robot.close();
