% Algorithm 1 on an emulated board: octave-cli follow.m URI
% What is measured is the model with the first motor's zero off by 6 deg, which feedback can correct.
robot = ccr.Client(argv(){1}, 115200);
robot.configure();
robot.arm();
measure = @() ccr.tip(deg2rad(robot.state().setpoint_cdeg' / 100 - [6; 0]));
q = deg2rad([linspace(8, 20, 25); linspace(-12, 6, 25)]);
f_mm = cell2mat(arrayfun(@(k) ccr.tip(q(:, k)), 1:25, 'UniformOutput', false));
[q_deg, error_mm] = algorithm_1(robot, measure, f_mm, [8 -12], 0.08);
robot.disarm();
robot.close();
printf('%.2f %.2f\n', error_mm(1), mean(error_mm(end - 9:end)));
