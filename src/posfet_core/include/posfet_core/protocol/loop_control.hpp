// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// Calls back the thread that decodes scans without an interpreter, and keeps it out of what it shares.
#pragma once

#include <atomic>
#include <mutex>

namespace posfet::protocol {

/// A request to end the call of a loop, and the mutex that the loop holds while it decodes.
class LoopControl {
public:
  /// Throws std::system_error where the system has no descriptor left.
  LoopControl();
  ~LoopControl();

  LoopControl(const LoopControl&) = delete;
  LoopControl& operator=(const LoopControl&) = delete;

  /// End the call of the loop that runs, or that is made next; from any thread. After this the loop hands on no scan
  /// before it is called once more.
  void wake();

  /// Whether the loop was woken since this was asked; for the loop.
  bool take_request() { return requested_.exchange(false); }

  /// Held while bytes are decoded and scans handed on, not while the loop waits.
  std::mutex& mutex() { return mutex_; }

  /// Readable from `wake` to `clear_event`.
  int descriptor() const { return descriptor_; }
  void clear_event() const;

private:
  int descriptor_;
  std::atomic<bool> requested_{false};
  std::mutex mutex_;
};

}  // namespace posfet::protocol
