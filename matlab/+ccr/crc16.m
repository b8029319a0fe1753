function crc = crc16(bytes)
%CRC16 CRC-16/X-25 of a row of bytes, as a number.
persistent table
if isempty(table)
  table = zeros(1, 256);
  for value = 0:255
    entry = value;
    for bit = 1:8
      if mod(entry, 2)
        entry = bitxor(floor(entry / 2), hex2dec('8408'));
      else
        entry = floor(entry / 2);
      end
    end
    table(value + 1) = entry;
  end
end
crc = 65535;
for byte = double(bytes(:)')
  crc = bitxor(floor(crc / 256), table(bitxor(mod(crc, 256), byte) + 1));
end
crc = bitxor(crc, 65535);
end
