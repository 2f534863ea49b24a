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
  if (closed_) {
    return Taken::kRefused;
  }
  if (!reconstructor_.process(scan)) {
    return Taken::kTaken;
  }
  failed_ = publishing_.publisher != nullptr && !publish();
  reconstructor_.run_maintenance();
  return failed_ ? Taken::kLast : Taken::kTaken;
}

bool ContactsSink::take_failure() { return std::exchange(failed_, false); }

/// Publish the contacts of the newest scan; return whether that was done.
bool ContactsSink::publish() {
  const ScanPath& path = reconstructor_.path();
  const ScanResult& result = path.result();
  const std::vector<std::uint8_t>& data = writer_.write(result.stamp, result.sequence, result.valid, path.contacts(),
                                                        path.shows_released(), path.motions());
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
