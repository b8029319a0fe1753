// Counters of the link since the reset. All wrap.
#ifndef CCR_LINK_COUNTERS_H
#define CCR_LINK_COUNTERS_H

#include <stdint.h>

#include "frame.h"

namespace ccr {

struct LinkCounters {
  uint32_t frames_accepted;
  uint16_t bad_crc;
  uint16_t bad_encoding;
  uint16_t bad_size;
  uint16_t overruns;
  uint16_t replies_dropped;
  uint16_t nacks;
  uint16_t repeats_answered;

  void count(Received received) {
    switch (received) {
      case Received::kNothing:
        break;
      case Received::kFrame:
        ++frames_accepted;
        break;
      case Received::kBadCrc:
        ++bad_crc;
        break;
      case Received::kBadEncoding:
        ++bad_encoding;
        break;
      case Received::kBadSize:
        ++bad_size;
        break;
    }
  }

  uint16_t link_errors() const {
    return static_cast<uint16_t>(bad_crc + bad_encoding + bad_size + overruns);
  }
};

}  // namespace ccr

#endif
