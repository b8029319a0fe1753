function [q_deg, error_mm] = algorithm_1(robot, measure, f_mm, q_deg, period_s)
%ALGORITHM_1 Algorithm 1 of the paper on an armed robot.
%   measure: function without arguments, the measured tip M3 - M1 in mm, (3, 1), frame of (10).
%   f_mm: desired tips, (3, n). q_deg: motor angles f^-1(f_1), (1, 2). period_s: between two steps.
%   Returns the commands, (n, 2), and the error norms at the ends of the periods, (n, 1).
Q = 1; R = 0.5; u_max = 2; N = 4;                             % mm^-2, rad^-2, rad
n = size(f_mm, 2);
q = deg2rad(q_deg(:));
q_deg = zeros(n, 2); error_mm = zeros(n, 1);
for i = 1:n
  if i > 1
    ahead = i:min(i + N - 2, n);                              % the horizon shrinks at the end
    k = numel(ahead);
    J = ccr.jacobian(q);                                      % (11)
    miss = f_mm(:, ahead) - repmat(f_m, 1, k);
    A = [sqrt(Q) * kron(tril(ones(k)), J); sqrt(R) * eye(2 * k)];   % (14), (15)
    u = A \ [sqrt(Q) * miss(:); zeros(2 * k, 1)];
    q = q + max(-u_max, min(u_max, u(1:2)));                  % (13)
  end
  q = deg2rad(robot.target(rad2deg(q), 0, 2 * period_s)');    % as the board accepted it
  pause(period_s);
  f_m = measure();
  q_deg(i, :) = rad2deg(q)';
  error_mm(i) = norm(f_m - f_mm(:, i));
end
end
