classdef Receiver < handle
  %RECEIVER Finds the frames in a stream of bytes.
  properties (Access = private)
    unfinished = zeros(1, 0);
    max_payload
  end
  methods
    function self = Receiver(max_payload)
      %RECEIVER For frames of payloads up to a length, by default the longest of any board.
      if nargin < 1
        s = ccr.spec();
        max_payload = s.max_payload_large;
      end
      self.max_payload = max_payload;
    end

    function found = feed(self, bytes)
      %FEED Add bytes; a cell row of structs with kind: frame (id, sequence, payload), bad_size,
      %   bad_encoding or bad_crc, in the order in which the bytes complete them.
      found = {};
      self.unfinished = [self.unfinished, double(bytes(:)')];
      while true
        last = find(self.unfinished == 0, 1);
        if isempty(last)
          break
        end
        encoded = self.unfinished(1:last - 1);
        self.unfinished = self.unfinished(last + 1:end);
        if ~isempty(encoded)
          found{end + 1} = ccr.Receiver.decode(encoded, self.max_payload); %#ok<AGROW>
        end
      end
    end
  end
  methods (Static)
    function outcome = decode(encoded, max_payload)
      %DECODE What stands between two zeros.
      outcome = struct('kind', 'bad_size');
      if numel(encoded) > max_payload + 5   % id, sequence number, CRC and the first code byte
        return
      end
      decoded = zeros(1, 0);
      at = 1;
      while at <= numel(encoded)
        code = encoded(at);
        if at + code - 1 > numel(encoded)
          outcome.kind = 'bad_encoding';
          return
        end
        decoded = [decoded, encoded(at + 1:at + code - 1)]; %#ok<AGROW>
        at = at + code;
        if code < 255 && at <= numel(encoded)
          decoded(end + 1) = 0; %#ok<AGROW>
        end
      end
      if numel(decoded) < 4 || numel(decoded) > max_payload + 4
        return
      end
      body = decoded(1:end - 2);
      if ccr.crc16(body) ~= decoded(end - 1) + 256 * decoded(end)
        outcome.kind = 'bad_crc';
        return
      end
      outcome = struct('kind', 'frame', 'id', body(1), 'sequence', body(2), 'payload', body(3:end));
    end
  end
end
