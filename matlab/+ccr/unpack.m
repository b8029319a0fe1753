function [reading, values, first_out_of_range] = unpack(id, payload, axes)
%UNPACK Name and values of a message; the name is unknown_id, bad_length or undefined_value where
%   the bytes are no message. first_out_of_range counts fields from 0 as nack does, or is empty.
%   Without axes, those of the board, the length tells them.
s = ccr.spec();
values = struct();
first_out_of_range = [];
reading = 'unknown_id';
if id < 1 || id > numel(s.names) || isempty(s.names{id})
  return
end
fields = s.messages.(s.names{id}).fields;
bytes = uint8(payload(:)');
counts = zeros(1, size(fields, 1));
widths = counts;
for row = 1:size(fields, 1)
  counts(row) = fields{row, 3};
  widths(row) = numel(typecast(cast(0, fields{row, 2}), 'uint8'));
end
if nargin < 3
  per_axis = sum(widths(counts == 0));
  axes = max(1, floor((numel(bytes) - sum(counts .* widths)) / max(1, per_axis)));
end
counts(counts == 0) = axes;
sizes = counts .* widths;
if sum(sizes) ~= numel(bytes)
  reading = 'bad_length';
  return
end
reading = s.names{id};
at = 0;
for row = 1:size(fields, 1)
  [field, type, ~, least, greatest, ~, enum] = fields{row, :};
  found = double(typecast(bytes(at + 1:at + sizes(row)), type));
  at = at + sizes(row);
  values.(field) = found;
  if isempty(first_out_of_range) && any(found < least | found > greatest)
    first_out_of_range = row - 1;
  end
  if isfield(s.enums, enum) && ~all(ismember(found, cell2mat(struct2cell(s.enums.(enum)))))
    reading = 'undefined_value';
  end
end
end
