// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
#include "posfet_core/protocol/loop_control.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <system_error>

namespace posfet::protocol {

LoopControl::LoopControl() : descriptor_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (descriptor_ < 0) {
    throw std::system_error(errno, std::generic_category(), "eventfd");
  }
}

LoopControl::~LoopControl() { close(descriptor_); }

void LoopControl::wake() {
  requested_ = true;
  const std::uint64_t one = 1;
  // It fails only where the counter is full: then it is readable already.
  [[maybe_unused]] const ssize_t written = write(descriptor_, &one, sizeof one);
  const std::scoped_lock last_batch(mutex_);
}

void LoopControl::clear_event() const {
  std::uint64_t count = 0;
  [[maybe_unused]] const ssize_t taken = read(descriptor_, &count, sizeof count);
}

}  // namespace posfet::protocol
