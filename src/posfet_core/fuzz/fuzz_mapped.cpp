// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Fuzzing of the decoder for boards with their own protocol: built with sanitizers by `make sanitize`.
///
/// An input is tables of a board and steps: frames of the board, any frames, calls of the decoder, times of arrival. It
/// ends at undefined behaviour, at an access outside of an object, and when memory is allocated after the decoder was
/// made. `LLVMFuzzerTestOneInput` is the entry of libFuzzer; without it (POSFET_FUZZ_MAIN), random inputs are made
/// here: `fuzz_mapped SECONDS SEED`.

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <random>
#include <vector>

#include "posfet_core/protocol/mapped_decoder.hpp"

namespace {

std::uint64_t allocated = 0;
std::uint64_t published = 0;

}  // namespace

void* operator new(std::size_t size) {
  ++allocated;
  if (void* memory = std::malloc(size == 0 ? 1 : size)) {
    return memory;
  }
  throw std::bad_alloc();
}

void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t /*size*/) noexcept { std::free(memory); }

namespace posfet::protocol {

namespace {

/// Reads an input; behind its end there are zeros.
class Input {
public:
  Input(const std::uint8_t* bytes, std::size_t size) : bytes_(bytes), left_(size) {}

  bool ended() const { return left_ == 0; }

  std::uint64_t number(std::size_t bytes) {
    std::uint64_t number = 0;
    for (std::size_t index = 0; index < bytes; ++index) {
      number = number << 8U | (left_ > 0 ? *bytes_ : 0U);
      bytes_ += left_ > 0 ? 1 : 0;
      left_ -= left_ > 0 ? 1 : 0;
    }
    return number;
  }

  /// Up to `size` bytes in a piece of memory of that size alone, so that a sanitizer sees what is read behind them.
  const std::uint8_t* take(std::size_t size, std::size_t& taken) {
    taken = size < left_ ? size : left_;
    const std::uint8_t* piece = bytes_;
    bytes_ += taken;
    left_ -= taken;
    return piece;
  }

private:
  const std::uint8_t* bytes_;
  std::size_t left_;
};

constexpr std::uint32_t kBase = 0x100;

BitField field_of(Input& input, std::size_t length, unsigned longest) {
  BitField field;
  field.first = input.number(1) % length;
  field.big = input.number(1) % 2 != 0;
  field.shift = static_cast<unsigned>(input.number(1)) % 8;
  field.length = 1 + static_cast<unsigned>(input.number(1)) % longest;
  field.end = field.first + (field.shift + field.length + 7) / 8;
  return field;
}

/// Tables of a board, which mostly fit together.
MappedTables tables_of(Input& input) {
  MappedTables tables;
  const std::size_t blocks = 1 + input.number(1) % 6;
  const std::size_t length = 1 + input.number(1) % kLongestFrame;
  const std::uint64_t how = input.number(1);
  tables.period = 1e6;
  tables.sequence_bits = how % 4 == 0 ? 0U : 1 + static_cast<unsigned>(input.number(1)) % kLongestSignal;
  tables.time_bits = how / 4 % 4 == 0 ? 0U : 1 + static_cast<unsigned>(input.number(1)) % kLongestSignal;
  tables.sequenced = tables.sequence_bits > 0 && how / 16 % 2 != 0;
  tables.timed = tables.time_bits > 0 && how / 32 % 2 != 0;
  tables.tick = tables.time_bits > 0 ? static_cast<double>(1 + input.number(4)) : 0.0;
  tables.ticks_back = real(values_of(tables.time_bits)) * 0.75;
  const BitField sequence = field_of(input, length, tables.sequence_bits + 1);
  const BitField time = field_of(input, length, tables.time_bits + 1);
  const bool one_message = how / 64 % 2 != 0;
  for (std::size_t block = 0; block < blocks; ++block) {
    tables.slots.push_back(length);
    MappedPart part;
    part.block = static_cast<int>(block);
    if (tables.sequenced || (tables.sequence_bits > 0 && block == blocks / 2)) {
      part.sequence = sequence;
    }
    if (tables.timed || (tables.time_bits > 0 && block == blocks - 1)) {
      part.time = time;
    }
    if (input.number(1) % 4 == 0) {
      const bool flag = input.number(1) % 2 != 0;
      part.readings.push_back({field_of(input, length, kLongestSignal), flag ? -1 : 1, flag ? 4U : 0U,
                               std::uint64_t{1} << input.number(1) % 64, 0.5, -40.0, -40.0, 150.0});
    }
    tables.parts.push_back(part);
    const int index = static_cast<int>(block);
    if (!one_message) {
      tables.messages.push_back({length, length + input.number(1) % 3, {}, {{0, index}}});
    } else if (block == 0) {
      tables.messages.push_back({length, length, field_of(input, length, kLongestSignal), {{0, index}}});
    } else {
      tables.messages.front().parts.emplace_back(block, index);
    }
  }
  for (std::size_t index = 0; index < tables.messages.size(); ++index) {
    tables.kinds.emplace_back(key_of(kBase + static_cast<std::uint32_t>(index), kClassic), index);
    tables.identifiers.emplace_back(kBase + static_cast<std::uint32_t>(index), false);
  }
  const std::size_t taxels = 1 + input.number(1) % 40;
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    tables.counts.push_back({taxel % blocks * length, field_of(input, length, kLongestCount), 0});
  }
  if (input.number(1) % 2 != 0) {
    tables.table.assign(std::size_t{1} << kLongestCount, 7);
  }
  return tables;
}

/// A decoder, and the times of its frames.
class Fed {
public:
  explicit Fed(const MappedTables& tables)
      : decoder_(tables), messages_(tables.messages.size()), length_(tables.slots.front()) {
    decoder_.start();
  }

  void step(Input& input) {
    switch (input.number(1) % 12) {
      case 0:
        decoder_.start();
        break;
      case 1:
        decoder_.note_overflow();
        break;
      case 2:
        decoder_.receiving = !decoder_.receiving;
        break;
      case 3:
        begin(static_cast<std::int64_t>(input.number(8)), input);
        break;
      case 4:
      case 5:
        begin(arrival_ + static_cast<std::int64_t>(input.number(4)) % (std::int64_t{1} << 40), input);
        break;
      case 6: {
        std::size_t size = 0;
        const std::uint32_t identifier = kBase - 1 + static_cast<std::uint32_t>(input.number(1)) % 8;
        const auto kind = static_cast<unsigned>(input.number(1)) % 32;
        const std::uint8_t* data = input.take(input.number(1) % (kLongestFrame + 1), size);
        feed({identifier, kind, data, size});
        break;
      }
      default:
        send(input);
    }
  }

private:
  void begin(std::int64_t arrival, Input& input) {
    arrival_ = arrival / 2;  // so that what is added to it fits
    decoder_.begin_batch(input.number(1) % 30, input.number(1) % 30, arrival_, 0);
  }

  /// Send the next frame of the board, mostly with small changes to the one before.
  void send(Input& input) {
    std::array<std::uint8_t, kLongestFrame>& data = data_.at(next_ % 6);
    for (std::uint64_t changes = input.number(1) % 4; changes > 0; --changes) {
      data.at(input.number(1) % kLongestFrame) = static_cast<std::uint8_t>(input.number(1));
    }
    feed({kBase + static_cast<std::uint32_t>(next_ % messages_), kClassic, data.data(), length_});
    next_ += input.number(1) % 9 == 0 ? 2 : 1;
  }

  void feed(const Frame& frame) {
    if (decoder_.feed(frame)) {
      ++published;
      checksum_ += decoder_.scan().status + decoder_.counts().front();
    }
    checksum_ += decoder_.clock_uncertainty() > 0.0 ? decoder_.frames_lost() : 0U;
  }

  MappedDecoder decoder_;
  std::size_t messages_;
  std::size_t length_;
  std::int64_t arrival_ = 0;
  std::size_t next_ = 0;
  std::array<std::array<std::uint8_t, kLongestFrame>, 6> data_{};
  std::uint64_t checksum_ = 0;  ///< So that what is read is used.
};

}  // namespace

}  // namespace posfet::protocol

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace posfet::protocol;
  Input input(bytes, size);
  const MappedTables tables = tables_of(input);
  if (!tables.consistent()) {
    return 0;
  }
  Fed fed(tables);
  const std::uint64_t before = allocated;
  while (!input.ended()) {
    fed.step(input);
  }
  if (allocated != before) {
    std::fprintf(stderr, "fuzz_mapped: memory was allocated\n");
    std::abort();
  }
  return 0;
}

#ifdef POSFET_FUZZ_MAIN

int main(int count, char** arguments) {
  const double seconds = count > 1 ? std::atof(arguments[1]) : 10.0;
  const std::uint64_t seed = count > 2 ? std::strtoull(arguments[2], nullptr, 10) : 1;
  std::fprintf(stderr, "fuzz_mapped: seed %llu\n", static_cast<unsigned long long>(seed));
  std::mt19937_64 noise(seed);
  const auto begin = std::chrono::steady_clock::now();
  std::uint64_t inputs = 0;
  while (std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() < seconds) {
    std::vector<std::uint8_t> input(noise() % 3000);
    for (std::uint8_t& byte : input) {
      byte = static_cast<std::uint8_t>(noise());
    }
    LLVMFuzzerTestOneInput(input.data(), input.size());
    ++inputs;
  }
  std::printf("fuzz_mapped: %llu inputs, %llu scans, no failure\n", static_cast<unsigned long long>(inputs),
              static_cast<unsigned long long>(published));
  return published > 0 ? 0 : 1;
}

#endif
