function J = jacobian(q)
%JACOBIAN df/dq of (11) in mm/rad, (3, 2), by central differences.
h = 1e-5;
J = zeros(3, 2);
for motor = 1:2
  step = h * ((1:2)' == motor);
  J(:, motor) = (ccr.tip(q(:) + step) - ccr.tip(q(:) - step)) / (2 * h);
end
end
