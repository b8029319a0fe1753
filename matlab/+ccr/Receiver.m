classdef Receiver < handle
  %RECEIVER Finds the frames in a stream of bytes.
  properties (Access = private)
    unfinished = zeros(1, 0);
  end
  methods
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
          found{end + 1} = ccr.Receiver.decode(encoded); %#ok<AGROW>
        end
      end
    end
  end
  methods (Static)
    function outcome = decode(encoded)
      %DECODE What stands between two zeros.
      s = ccr.spec();
      outcome = struct('kind', 'bad_size');
      if numel(encoded) > s.max_encoded
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
      if numel(decoded) < 4 || numel(decoded) > s.max_decoded
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
