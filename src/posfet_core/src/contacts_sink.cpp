// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
#include "posfet_core/contacts_sink.hpp"

#include <utility>
#include <vector>

namespace posfet {

Taken ContactsSink::take(const Scan& scan) {
  const std::scoped_lock lock(mutex_);
  if (closed_ || is_for_python(scan)) {
    return Taken::kRefused;
  }
  if (!path_.receive(scan)) {
    return Taken::kTaken;
  }
  path_.begin(scan);
  path_.finish();
  failed_ = publishing_.publisher != nullptr && !publish();
  return failed_ || path_.is_block_due(block_) ? Taken::kLast : Taken::kTaken;
}

bool ContactsSink::take_failure() { return std::exchange(failed_, false); }

/// Whether a block is due before the scan, or the estimator has to start with it.
bool ContactsSink::is_for_python(const Scan& scan) const {
  if (path_.is_block_due(block_) || !path_.integration().block().started) {
    return true;
  }
  ScanClock clock = path_.clock();
  if (!clock.fits(scan) || !clock.is_new(scan)) {
    return false;
  }
  clock.admit(scan);
  return clock.interrupted();
}

/// Publish the contacts of the newest scan; return whether that was done.
bool ContactsSink::publish() {
  const ScanResult& result = path_.result();
  const std::vector<std::uint8_t>& data = writer_.write(result.stamp, result.sequence, result.valid, path_.contacts(),
                                                        path_.shows_released(), path_.motions());
  SerializedMessage message;
  message.buffer = data.data();
  message.length = message.capacity = data.size();
  if (publishing_.publish(publishing_.publisher, &message, nullptr) == 0) {
    return true;
  }
  publishing_.reset_error();
  return false;
}

}  // namespace posfet
