// What a host may have outstanding on this board: the protocol's limits, unless the build has others.
#ifndef CCR_LINK_LIMITS_H
#define CCR_LINK_LIMITS_H

#include "ccr_messages.h"

#ifndef CCR_OUTSTANDING_REQUESTS
#define CCR_OUTSTANDING_REQUESTS ccr::kOutstandingRequests
#endif
#ifndef CCR_OUTSTANDING_BYTES
#define CCR_OUTSTANDING_BYTES ccr::kOutstandingBytes
#endif

namespace ccr {

constexpr LinkLimitsReply kLinkLimits = {CCR_OUTSTANDING_REQUESTS, CCR_OUTSTANDING_BYTES};

/// Only other limits than those of the protocol are announced.
constexpr bool kAnnouncesLinkLimits = kLinkLimits.outstanding_requests != kOutstandingRequests ||
                                      kLinkLimits.outstanding_bytes != kOutstandingBytes;

}  // namespace ccr

#endif
