function groups = default_config()
%DEFAULT_CONFIG Configuration of the default robot description, one struct a group.
%   Change what differs on your robot: angles in 0.01 deg, pulses in 0.5 us.
groups.limits = struct('angle_min_cdeg', [-8500 -8500], 'angle_max_cdeg', [8500 8500], ...
  'rest_cdeg', [0 0]);
groups.slew = struct('slew_cdeg_tick', [600 600]);
groups.watchdog = struct('relax_after_ms', 2000, 'relax_slew_cdeg_tick', 60, 'arm_axis_ms', 300);
groups.calibration = struct('neutral_half_us', [3000 3000], 'per_90_deg_half_us', [2000 2000], ...
  'pulse_min_half_us', [1000 1000], 'pulse_max_half_us', [5000 5000]);
groups.acceleration = struct('acceleration_cdeg_tick2', [0 0]);
end
