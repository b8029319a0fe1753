classdef Client < handle
  %CLIENT A board over TCP or a serial port, in MATLAB and in Octave (package instrument-control).
  %   robot = ccr.Client('tcp://127.0.0.1:5025');   or 'serial:COM3', 'serial:/dev/ttyACM0'
  %   robot.configure();  robot.arm();  robot.target([10 -20]);  robot.disarm();
  %   Nothing runs in the background: a target holds for its validity; then the board holds the
  %   pose, and after that leads the robot to rest by itself. See docs/matlab.md.
  properties (SetAccess = private)
    identity   % the board's hello_reply
    accepted_deg   % motor angles as the board accepted them last
  end
  properties (Access = private)
    port
    receiver
    session
    sequence = 0;
    is_armed = false;
    rest_cdeg = [];   % of all axes, from configure
  end
  methods
    function self = Client(uri, baud)
      s = ccr.spec();
      if nargin < 2
        baud = s.baud;   % of the firmware as it is shipped; 115200 if it was built for that
      end
      self.port = ccr.Client.open(uri, baud);
      self.receiver = ccr.Receiver();
      self.session = floor(rand() * 65535) + 1;
      asked = struct('protocol_version', s.protocol_version, 'spec_hash', s.spec_hash);
      self.identity = self.request('hello', asked, 50);   % a boot loader answers after 1 to 2 s
      if self.identity.spec_hash ~= s.spec_hash
        error('ccr:spec', ['the board speaks protocol %d, spec %08X, this client spec %08X: ' ...
          'flash the board with ccr-host flash'], self.identity.protocol_version, ...
          self.identity.spec_hash, s.spec_hash);
      end
      self.open_session();
    end

    function reply = request(self, name, values, attempts)
      %REQUEST Send a message and return the values of its reply; nack is an error.
      s = ccr.spec();
      message = s.messages.(name);
      if nargin < 3
        values = struct();
      end
      if ~isempty(message.optional)
        self.require(name, s.flags.capabilities.(message.optional));
      end
      if message.session
        values.session = self.session;
      end
      if nargin < 4
        attempts = 8;   % the board answers a repeated request from memory within a second
      end
      patience_s = 0.1;
      if strcmp(message.retry, 'never')
        [attempts, patience_s] = deal(1, 1);
      end
      self.sequence = mod(self.sequence + 1, 256);
      bytes = ccr.frame(message.id, self.sequence, ccr.pack(name, values));
      for attempt = 1:attempts
        write(self.port, bytes);
        reply = self.answer(message, patience_s);
        if ~isempty(reply)
          return
        end
      end
      error('ccr:silent', '%s: no answer from the board', name);
    end

    function configure(self, groups)
      %CONFIGURE Set limits, slew, watchdog, calibration and acceleration; by default those of
      %   ccr.default_config(). Further axes of the board are as the last one given. The robot must
      %   not be armed.
      if nargin < 2
        groups = ccr.default_config();
      end
      names = fieldnames(groups);
      for number = 1:numel(names)
        message = ['set_' names{number}];
        self.request(message, self.for_board(message, groups.(names{number})));
      end
      self.rest_cdeg = self.for_board('set_limits', groups.limits).rest_cdeg;
    end

    function arm(self)
      %ARM Enable the servos; returns when the robot is at rest and the board holds it.
      self.is_armed = true;
      self.request('arm');
      report = self.wait_for('hold', 100 + 20 * self.identity.axes);
      self.accepted_deg = report.setpoint_cdeg / 100;
    end

    function deg = target(self, q_deg, ramp_s, validity_s)
      %TARGET Command motor angles in degrees; returns them as the board accepted them. Axes of the
      %   board beyond the motors given stay at rest.
      %   ramp_s: duration of the motion, 0 by default. validity_s: how long the target holds, 1.
      if nargin < 3
        ramp_s = 0;
      end
      if nargin < 4
        validity_s = 1;
      end
      target_cdeg = [round(100 * q_deg(:)'), self.rest_cdeg(numel(q_deg) + 1:end)];
      reply = self.request('set_target', struct('target_cdeg', target_cdeg, 'ramp_ms', ...
        round(1000 * ramp_s), 'validity_ms', round(1000 * validity_s)));
      self.accepted_deg = reply.target_cdeg / 100;
      deg = self.accepted_deg;
    end

    function report = state(self)
      %STATE The board's report; report.state and report.fault as texts besides.
      s = ccr.spec();
      report = self.request('get_state');
      report.state_name = ccr.Client.name_of(s.enums.state, report.state);
      report.fault_name = ccr.Client.name_of(s.enums.fault, report.fault);
    end

    function disarm(self)
      %DISARM Lead the robot to rest and end the pulses; returns when that is done.
      self.request('disarm');
      self.wait_for('disarmed', 3100);
      self.is_armed = false;
    end

    function stop(self)
      %STOP Emergency stop: the pulses end at once; clear_fault and arm enable them again.
      self.request('stop');
      self.is_armed = false;
    end

    function clear_fault(self)
      self.request('clear_fault');
    end

    function close(self)
      %CLOSE Make the robot safe and disconnect.
      if self.is_armed
        try
          self.disarm();
        catch
          self.stop();
        end
      end
      self.port = [];
    end

    function delete(self)
      if ~isempty(self.port)
        self.close();
      end
    end
  end

  methods (Access = private)
    function require(self, name, capability)
      %REQUIRE A board of older firmware is not sent what it does not know.
      if ~bitand(self.identity.capabilities, capability)
        error('ccr:capability', ['the board''s firmware (%d.%d.%d) does not know %s: ' ...
          'flash the board with ccr-host flash'], self.identity.firmware_version, name);
      end
    end

    function values = for_board(self, name, values)
      %FOR_BOARD Per-axis fields of a message, repeated up to the number of the board's axes.
      s = ccr.spec();
      fields = s.messages.(name).fields;
      for row = find(cell2mat(fields(:, 3))' == 0)
        field = fields{row, 1};
        values.(field)(end + 1:self.identity.axes) = values.(field)(end);
      end
    end

    function open_session(self)
      %OPEN_SESSION A board that has just started answers hello, but refuses this for 0.1 s.
      s = ccr.spec();
      asked = struct('spec_hash', s.spec_hash, 'session', self.session);
      started = tic();
      while true
        try
          self.request('open_session', asked);
          return
        catch refusal
          if isempty(strfind(refusal.message, 'bad_state')) || toc(started) > 5
            rethrow(refusal);
          end
          pause(0.02);
        end
      end
    end

    function reply = answer(self, message, patience_s)
      %ANSWER The reply to the newest request, empty if there is none in time.
      reply = [];
      started = tic();
      while toc(started) < patience_s
        waiting = self.port.NumBytesAvailable;
        if waiting < 1
          pause(0.001);
          continue
        end
        found = self.receiver.feed(read(self.port, waiting));
        for number = 1:numel(found)
          one = found{number};
          if strcmp(one.kind, 'frame') && one.sequence == self.sequence
            [name, values] = ccr.unpack(one.id, one.payload);
            if strcmp(name, 'nack') && values.request == message.id
              s = ccr.spec();
              error('ccr:refused', 'the board refuses: %s', ...
                ccr.Client.name_of(s.enums.nack_code, values.code));
            elseif one.id == message.reply
              reply = values;
              return
            end
          end
        end
      end
    end

    function report = wait_for(self, wanted, attempts)
      for attempt = 1:attempts
        report = self.state();
        if strcmp(report.state_name, wanted)
          return
        elseif any(strcmp(report.state_name, {'fault', 'stopped'}))
          error('ccr:fault', 'the board is in %s: %s', report.state_name, report.fault_name);
        end
        pause(0.02);
      end
      error('ccr:state', 'the board is in %s instead of %s', report.state_name, wanted);
    end
  end

  methods (Static)
    function port = open(uri, baud)
      %OPEN A port from tcp://HOST:PORT or serial:NAME.
      if exist('OCTAVE_VERSION', 'builtin')
        pkg('load', 'instrument-control');
      end
      tcp = regexp(uri, '^tcp://(.+):(\d+)$', 'tokens', 'once');
      if ~isempty(tcp)
        port = tcpclient(tcp{1}, str2double(tcp{2}));
      elseif strncmp(uri, 'serial:', 7)
        port = serialport(uri(8:end), baud);
      else
        error('ccr:uri', '%s: neither tcp://HOST:PORT nor serial:NAME', uri);
      end
    end

    function name = name_of(enum, value)
      %NAME_OF Name of a value of an enumeration.
      names = fieldnames(enum);
      name = names{cell2mat(struct2cell(enum)) == value};
    end
  end
end
