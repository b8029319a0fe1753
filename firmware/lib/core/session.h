// The open session: its number, telemetry and last request.
#ifndef CCR_SESSION_H
#define CCR_SESSION_H

#include <stdint.h>

#include "retry_memory.h"
#include "telemetry_stream.h"

namespace ccr {

constexpr uint16_t kNoSession = 0;

struct Session {
  uint16_t number = kNoSession;
  TelemetryStream telemetry;
  RetryMemory retries;

  void open(uint16_t new_number) {
    number = new_number;
    telemetry.stop();
    retries.forget();
  }
  bool is_open() const { return number != kNoSession; }
};

}  // namespace ccr

#endif
