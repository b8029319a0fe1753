// What a golden vector consists of, and how a payload is read into the words it expects.
#pragma once

#include <doctest/doctest.h>
#include <stdint.h>

#include <string>
#include <vector>

#include "frame.h"

using Bytes = std::vector<uint8_t>;
using Values = std::vector<int64_t>;

struct Vector {
  const char* stream;    ///< Hexadecimal.
  const char* outcomes;  ///< A line for each.
};

struct Request {
  ccr::RequestRule rule;  ///< Without the bits of the states.
  std::vector<ccr::State> states;
};

struct Step {
  ccr::State before;
  ccr::Event event;
  ccr::State after;
};

/// Name of the message, the verdicts on it and its values; or the reason why it is none.
template <typename Message>
std::string read(const char* name, const uint8_t* payload, uint8_t size) {
  Message message;
  switch (ccr::decode(payload, size, message)) {
    case ccr::Reading::kBadLength:
      return "bad_length";
    case ccr::Reading::kUndefinedValue:
      return "undefined_value";
    case ccr::Reading::kOk:
      break;
  }
  Bytes again(Message::kSize);
  ccr::encode(message, again.data());
  CHECK(again == Bytes(payload, payload + size));

  std::string words = name;
  words += " " + std::to_string(ccr::first_out_of_range(message));
  words += " " + std::to_string(ccr::inconsistent_axis(message));
  for (const int64_t value : flatten(message)) {
    words += " " + std::to_string(value);
  }
  return words;
}

void check(size_t index);
