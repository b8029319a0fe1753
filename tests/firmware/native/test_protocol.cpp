// Runs every golden vector through the firmware's codec, and its properties on noise.
#include "vectors.h"

#include <random>

namespace {

const char* name_of(ccr::Received received) {
  switch (received) {
    case ccr::Received::kNothing:
      return "nothing";
    case ccr::Received::kFrame:
      return "frame";
    case ccr::Received::kBadCrc:
      return "bad_crc";
    case ccr::Received::kBadEncoding:
      return "bad_encoding";
    case ccr::Received::kBadSize:
      return "bad_size";
  }
  return "";
}

Bytes encoded(uint8_t id, uint8_t sequence, const Bytes& payload) {
  uint8_t wire[ccr::kMaxWireFrame];
  const uint8_t size = ccr::encode_frame(id, sequence, payload.data(),
                                         static_cast<uint8_t>(payload.size()), wire);
  return Bytes(wire, wire + size);
}

std::string hex(const Bytes& bytes) {
  const char* digits = "0123456789abcdef";
  std::string text;
  for (const uint8_t byte : bytes) {
    text += digits[byte >> 4];
    text += digits[byte & 0x0F];
  }
  return text;
}

Bytes unhex(const std::string& text) {
  Bytes bytes;
  for (size_t at = 0; at < text.size(); at += 2) {
    bytes.push_back(static_cast<uint8_t>(std::stoul(text.substr(at, 2), nullptr, 16)));
  }
  return bytes;
}

Bytes payload_of(const ccr::FrameDecoder& decoder) {
  return Bytes(decoder.payload(), decoder.payload() + decoder.payload_size());
}

std::string describe(const ccr::FrameDecoder& decoder) {
  const Bytes payload = payload_of(decoder);
  return "frame " + std::to_string(decoder.id()) + " " + std::to_string(decoder.sequence()) + " " +
         hex(payload) + " " + hex(encoded(decoder.id(), decoder.sequence(), payload)) + " " +
         read_message(decoder.id(), payload.data(), decoder.payload_size());
}

struct Count {
  unsigned frames = 0;
  unsigned errors = 0;
};

Count feed(ccr::FrameDecoder& decoder, const Bytes& stream) {
  Count count;
  for (const uint8_t byte : stream) {
    const ccr::Received received = decoder.feed(byte);
    count.frames += received == ccr::Received::kFrame;
    count.errors += received != ccr::Received::kFrame && received != ccr::Received::kNothing;
  }
  return count;
}

Bytes noise(std::mt19937& random, size_t size, unsigned least) {
  std::uniform_int_distribution<unsigned> any(least, 255);
  Bytes bytes(size);
  for (uint8_t& byte : bytes) {
    byte = static_cast<uint8_t>(any(random));
  }
  return bytes;
}

}  // namespace

void check(size_t index) {
  ccr::FrameDecoder decoder;
  std::string outcomes;
  for (const uint8_t byte : unhex(kVectors[index].stream)) {
    const ccr::Received received = decoder.feed(byte);
    if (received != ccr::Received::kNothing) {
      outcomes += outcomes.empty() ? "" : "\n";
      outcomes += received == ccr::Received::kFrame ? describe(decoder) : name_of(received);
    }
  }
  CHECK(outcomes == kVectors[index].outcomes);
}

TEST_CASE("every state answers every event as the vectors say") {
  for (const Step& step : kSteps) {
    CAPTURE(static_cast<int>(step.before));
    CAPTURE(static_cast<int>(step.event));
    CHECK(static_cast<int>(ccr::next_state(step.before, step.event)) ==
          static_cast<int>(step.after));
  }
  CHECK(sizeof(kSteps) / sizeof(kSteps[0]) > 50);
}

TEST_CASE("after any noise and a zero the next frame is understood") {
  std::mt19937 random(1);
  ccr::FrameDecoder decoder;
  const Bytes good = encoded(ccr::Stop::kId, 77, {});
  for (int round = 0; round < 2000; ++round) {
    Bytes stream = noise(random, random() % 300, round % 2);
    stream.push_back(0);
    feed(decoder, stream);
    const Count count = feed(decoder, good);
    CHECK(count.frames == 1);
    CHECK(count.errors == 0);
    CHECK(decoder.id() == ccr::Stop::kId);
    CHECK(decoder.sequence() == 77);
  }
}

TEST_CASE("a decoded frame is the encoded one, for payloads of every length") {
  std::mt19937 random(2);
  ccr::FrameDecoder decoder;
  for (unsigned size = 0; size <= ccr::kMaxPayload; ++size) {
    for (int round = 0; round < 20; ++round) {
      Bytes payload = noise(random, size, 0);
      for (uint8_t& byte : payload) {
        byte = random() % 4 == 0 ? uint8_t{0} : byte;
      }
      const uint8_t id = static_cast<uint8_t>(random());
      const uint8_t sequence = static_cast<uint8_t>(random());
      const Count count = feed(decoder, encoded(id, sequence, payload));
      CHECK(count.frames == 1);
      CHECK(count.errors == 0);
      CHECK(decoder.id() == id);
      CHECK(decoder.sequence() == sequence);
      CHECK(payload_of(decoder) == payload);
    }
  }
}

TEST_CASE("a payload that is too long is not encoded") {
  CHECK(encoded(1, 2, Bytes(ccr::kMaxPayload + 1)).empty());
}

TEST_CASE("requests have the rules of the vectors, and no other id is one") {
  unsigned found = 0;
  for (unsigned id = 0; id <= 255; ++id) {
    found += ccr::find_request(static_cast<uint8_t>(id)) != nullptr;
  }
  CHECK(found == sizeof(kRequests) / sizeof(kRequests[0]));
  for (const Request& request : kRequests) {
    const ccr::RequestRule* rule = ccr::find_request(request.rule.id);
    REQUIRE(rule != nullptr);
    CAPTURE(rule->id);
    CHECK(rule->id == request.rule.id);
    CHECK(rule->reply_id == request.rule.reply_id);
    CHECK(rule->size == request.rule.size);
    CHECK((rule->retry == request.rule.retry));
    CHECK(rule->needs_session == request.rule.needs_session);
    unsigned allowed = 0;
    for (uint8_t state = 0; ccr::is_state(state); ++state) {
      allowed += ccr::is_allowed(*rule, static_cast<ccr::State>(state));
    }
    CHECK(allowed == request.states.size());
    for (const ccr::State state : request.states) {
      CHECK(ccr::is_allowed(*rule, state));
    }
  }
}
