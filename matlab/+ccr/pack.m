function payload = pack(name, values)
%PACK Payload of a message as a row of bytes; a value out of range is an error.
%   ccr.pack('blink', struct('duration_s', 5))
s = ccr.spec();
fields = message_of(name, s).fields;
payload = zeros(1, 0, 'uint8');
for row = 1:size(fields, 1)
  [field, type, count, least, greatest] = fields{row, 1:5};
  if ~isfield(values, field)
    error('ccr:pack', '%s: the field %s is missing', name, field);
  end
  if count == 0   % one element for each axis of the board, which checks how many
    count = max(1, min(s.max_axes, numel(values.(field))));
  end
  given = double(values.(field)(:)');
  if numel(given) ~= count || any(given ~= round(given)) || any(given < least | given > greatest)
    error('ccr:pack', '%s: %s is [%s], not %d whole numbers in %g..%g', name, field, ...
      num2str(given), count, least, greatest);
  end
  payload = [payload, typecast(cast(given, type), 'uint8')]; %#ok<AGROW>
end
end

function message = message_of(name, s)
if ~isfield(s.messages, name)
  error('ccr:pack', 'no message %s; one of %s', name, strjoin(fieldnames(s.messages)', ', '));
end
message = s.messages.(name);
end
