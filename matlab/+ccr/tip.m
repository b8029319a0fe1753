function f_mm = tip(q)
%TIP f of (10) in mm, (3, 1), at motor angles q in rad: the straight robot points along -y.
%   With the geometry of Table I; change it here for another robot.
[L1, L2, d_m, gain] = deal(58.5, 43.5, 15, 12.5 / 4.5);
theta = gain * q(:);
arc = @(t) (exp(1i * t) - 1) ./ (1i * t + (t == 0)) + (t == 0);
bent = exp(1i * theta(1));
s = L1 * arc(theta(1)) + (L2 * real(arc(theta(2))) + 1i * d_m) * bent - 1i * d_m;
f_mm = [L2 * imag(arc(theta(2))); -real(s); imag(s)];
end
