function bytes = frame(id, sequence, payload)
%FRAME Bytes of a frame on the wire: id, sequence, payload and CRC, COBS-encoded, and a zero.
body = [double(id), double(sequence), double(payload(:)')];
crc = ccr.crc16(body);
rest = [body, mod(crc, 256), floor(crc / 256)];
encoded = zeros(1, 0);
while true
  zero = find(rest == 0, 1);
  if isempty(zero)
    zero = numel(rest) + 1;
  end
  encoded = [encoded, zero, rest(1:zero - 1)]; %#ok<AGROW>
  if zero > numel(rest)
    break
  end
  rest = rest(zero + 1:end);
end
bytes = uint8([encoded, 0]);
end
