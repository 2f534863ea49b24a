// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// Records when each message is published, and publishes it: takes the place of rcl's function without an interpreter.

#include <cstdint>
#include <cstring>
#include <ctime>

namespace {

/// What a message begins with, as rcl takes it.
struct Message {
  const std::uint8_t* buffer;
  std::size_t length;
};

using Publish = int (*)(const void*, const Message*, void*);

Publish publish = nullptr;
std::size_t position = 0;
std::int64_t* records = nullptr;  // pairs of sequence and monotonic time [ns]
std::size_t capacity = 0;
std::size_t count = 0;

}  // namespace

/// Record up to `most` messages with the sequence at the byte `place`, and publish by `real`.
extern "C" void record_into(void* real, std::size_t place, std::int64_t* pairs, std::size_t most) {
  publish = reinterpret_cast<Publish>(real);
  position = place;
  records = pairs;
  capacity = most;
  count = 0;
}

extern "C" std::size_t recorded() { return count; }

extern "C" int recorded_publish(const void* publisher, const Message* message, void* allocation) {
  if (count < capacity) {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    std::memcpy(records + 2 * count, message->buffer + position, sizeof *records);
    records[2 * count + 1] = now.tv_sec * std::int64_t{1'000'000'000} + now.tv_nsec;
    ++count;
  }
  return publish(publisher, message, allocation);
}
