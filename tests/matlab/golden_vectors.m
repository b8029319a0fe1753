% Every golden vector, received and sent: octave-cli golden_vectors.m VECTORS.json
told = jsondecode(fileread(argv(){1}));
frames = 0;
for number = 1:numel(told.vectors)
  one = told.vectors(number);
  if iscell(told.vectors) one = told.vectors{number}; end
  stream = uint8(hex2dec(reshape(one.stream, 2, [])'))';
  s = ccr.spec();
  longest = s.max_payload_large;
  if one.axes <= s.small_axes longest = s.max_payload_small; end
  found = ccr.Receiver(longest).feed(stream);
  expected = one.outcomes;
  if isstruct(expected) expected = num2cell(expected); end
  assert(numel(found), numel(expected), one.name);
  for place = 1:numel(expected)
    wanted = expected{place};
    got = found{place};
    assert(got.kind, wanted.kind, one.name);
    if ~strcmp(wanted.kind, 'frame') continue; end
    frames += 1;
    assert([got.id, got.sequence], [wanted.id, wanted.sequence]);
    assert(strcmp([sprintf('%02x', got.payload) ''], [wanted.payload '']) || (isempty(got.payload) && isempty(wanted.payload)), one.name);
    [reading, values, out] = ccr.unpack(got.id, got.payload, one.axes);
    assert(reading, wanted.reading, one.name);
    assert(sprintf('%02x', ccr.frame(got.id, got.sequence, got.payload)), wanted.encoded);
    if ~isfield(wanted, "fields") || isempty(wanted.fields) continue; end
    flat = wanted.fields;
    for field = fieldnames(flat)'
      if isstruct(flat.(field{1})) flat = flat.(field{1}); end   % the struct of the message
    end
    for field = fieldnames(flat)'
      assert(values.(field{1})(:), double(flat.(field{1})(:)));
    end
    if isempty(wanted.first_out_of_range)
      assert(isempty(out), one.name);
      assert(ccr.pack(reading, values), uint8(got.payload));
    else
      assert(out, wanted.first_out_of_range);
    end
  end
end
printf('%d vectors, %d frames\n', numel(told.vectors), frames);
