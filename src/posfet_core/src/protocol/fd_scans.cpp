// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/fd_scans.hpp"

#include <optional>

namespace posfet::protocol {

bool FdScans::feed(const Frame& frame, Wide arrival) {
  ScanStatistics& statistics = assembler_.statistics;
  if (frame.length != kFdLength || (frame.kind != kFd && frame.kind != (kFd | kRateSwitch))) {
    ++statistics.malformed;
    return false;
  }
  const FdHeader header = fd_header(frame.data);
  if (header.checksum != fd_checksum(frame.data)) {
    ++statistics.checksum;
    return false;
  }
  if (header.block >= assembler_.blocks()) {
    ++statistics.malformed;
    return false;
  }
  if (!begun_ || header.sequence != current_.sequence || header.boot != current_.boot) {
    if (!begin(header, arrival)) {
      return false;
    }
  } else if (header.time != current_.time) {
    ++statistics.frozen_counter;
    assembler_.abandon();
    current_.time = header.time;
    return false;
  }
  return assembler_.add(header.block, header.status, frame.data) == BlockOutcome::kComplete;
}

bool FdScans::begin(const FdHeader& header, Wide arrival) {
  const std::optional<std::int64_t> missing = numbering_.missing({header.boot, header.sequence, header.time}, arrival);
  if (!missing || *missing < 0) {
    return false;
  }
  assembler_.begin();
  assembler_.count_lost(static_cast<Counter>(*missing));
  begun_ = true;
  current_ = header;
  return true;
}

}  // namespace posfet::protocol
