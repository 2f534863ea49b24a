// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Fuzzing of the compiled path from bytes to scans: built with sanitizers by `make sanitize`.
///
/// An input is a board (format, size, identifier) and steps: bytes of an adapter's lines, bytes of a kernel's frame, a
/// frame of the board, calls of the decoder, times of arrival. It ends at undefined behaviour, at an access outside of
/// an object, and when memory is allocated after the objects were made. `LLVMFuzzerTestOneInput` is the entry of
/// libFuzzer; without it (POSFET_FUZZ_MAIN), random inputs are made here: `fuzz_protocol SECONDS SEED`.

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>
#include <random>
#include <vector>

#include "posfet_core/protocol/board_decoder.hpp"
#include "posfet_core/protocol/kernel_frame.hpp"
#include "posfet_core/protocol/slcan.hpp"

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

/// A board's decoder, fed as a thread feeds it.
class Fed {
public:
  Fed(const ScanFormat& format, std::uint32_t base) : decoder_(format, base), base_(base) {}

  void step(Input& input) {
    switch (input.number(1) % 16) {
      case 0:
        decoder_.end_batch();
        arrival_ = static_cast<std::int64_t>(static_cast<std::uint64_t>(arrival_) + input.number(4));
        decoder_.begin_batch(arrival_, 0);
        break;
      case 1:
        arrival_ = static_cast<std::int64_t>(input.number(8));
        decoder_.begin_batch(arrival_, static_cast<std::int64_t>(input.number(8)));
        break;
      case 2:
        decoder_.start();
        break;
      case 3:
        control(input);
        break;
      case 4:
      case 5:
        read_lines(input);
        break;
      case 6:
        read_kernel_frame(input);
        break;
      case 7:
        send_message(input);
        break;
      default:
        send_block(input);
    }
  }

private:
  void feed(const Frame& frame) {
    const Counter before = decoder_.scans();
    const Found found = decoder_.feed(frame);
    if (found == Found::kReleased && (frame.length & 1U) == 0) {
      while (decoder_.release()) {
      }
    }
    published += decoder_.scans() - before;
    checksum_ += decoder_.scan().status + decoder_.assembler().counts().front();
    checksum_ += frame.length > 0 ? frame.data[frame.length - 1] : 0U;
  }

  void control(Input& input) {
    switch (input.number(1) % 7) {
      case 0:
        decoder_.doubt_sequence();
        break;
      case 1:
        decoder_.forget_gap();
        break;
      case 2:
        decoder_.note_overflow();
        break;
      case 3:
        decoder_.receiving = !decoder_.receiving;
        break;
      case 4:
        decoder_.set_period(static_cast<double>(input.number(3)), input.number(1) % 2 == 0);
        break;
      case 5:
        decoder_.forget_status();
        break;
      default:
        std::size_t size = 0;
        const std::uint8_t* command = input.take(input.number(1) % 12, size);
        decoder_.sent(command, size);
    }
    checksum_ += decoder_.clock_uncertainty() > 0.0 ? 1U : 0U;
  }

  void read_lines(Input& input) {
    std::size_t size = 0;
    const std::uint8_t* piece = input.take(input.number(1), size);
    reader_.read(piece, size, [this](const Frame& frame) { feed(frame); });
  }

  void read_kernel_frame(Input& input) {
    std::size_t size = 0;
    const std::uint8_t* piece = input.take(input.number(1) % 2 != 0 ? kKernelFdFrame : 16, size);
    if (const auto frame = parse_kernel_frame(piece, size)) {
      feed(*frame);
    }
  }

  void send_message(Input& input) {
    std::size_t size = 0;
    const std::uint32_t offset = static_cast<std::uint32_t>(input.number(1)) % 8;
    const std::uint8_t* data = input.take(kShortLength, size);
    feed({base_ + offset, kClassic, data, size});
  }

  /// Send a block that is right in form, and mostly near the one before.
  void send_block(Input& input) {
    const std::uint64_t how = input.number(1);
    sequence_ += how % 8 == 7 ? static_cast<std::uint32_t>(input.number(4)) : static_cast<std::uint32_t>(how % 3);
    time_ +=
        how / 8 % 8 == 7 ? static_cast<std::uint32_t>(input.number(4)) : static_cast<std::uint32_t>(how % 3) * 1000;
    boot_ = how / 64 == 3 ? static_cast<std::uint8_t>(input.number(1) & 0xFU) : boot_;
    const bool fd = decoder_.assembler().format().fd;
    const std::size_t block = how / 64 == 2 ? input.number(1) : next_block_++ % decoder_.assembler().blocks();
    std::array<std::uint8_t, kLongestFrame> data{};
    std::memcpy(data.data(), &sequence_, sizeof sequence_);
    std::memcpy(data.data() + 4, &time_, sizeof time_);
    if (fd) {
      data[8] = static_cast<std::uint8_t>(block);
      data[9] = static_cast<std::uint8_t>(boot_ << 4U);
      const std::uint16_t crc = fd_checksum(data.data());
      std::memcpy(data.data() + 10, &crc, sizeof crc);
      feed({base_ + kFdBlockOffset, kFd | kRateSwitch, data.data(), kFdLength});
    } else if (block == 0 && how / 64 == 1) {
      data[7] = static_cast<std::uint8_t>((data[7] & 0xFU) | boot_ << 4U);
      feed({base_ + kHeaderOffset, kClassic, data.data(), kShortLength});
    } else {
      feed({base_ + kClassicBlockOffset + static_cast<std::uint32_t>(block), kClassic, data.data(), kShortLength});
    }
  }

  BoardDecoder decoder_;
  LineReader reader_;
  std::uint32_t base_;
  std::int64_t arrival_ = 0;
  std::uint32_t sequence_ = 0;
  std::uint32_t time_ = 0;
  std::uint8_t boot_ = 0;
  std::size_t next_block_ = 0;
  std::uint64_t checksum_ = 0;  ///< So that what is read is used.
};

}  // namespace

}  // namespace posfet::protocol

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace posfet::protocol;
  Input input(bytes, size);
  const std::uint64_t board = input.number(2);
  const std::size_t taxels = 1 + (board % 16 == 0 ? board % kMostTaxels : board / 2 % 80);
  Fed fed({board % 2 == 0, taxels}, static_cast<std::uint32_t>(input.number(2)));
  const std::uint64_t before = allocated;
  while (!input.ended()) {
    fed.step(input);
  }
  if (allocated != before) {
    std::fprintf(stderr, "fuzz_protocol: memory was allocated\n");
    std::abort();
  }
  return 0;
}

#ifdef POSFET_FUZZ_MAIN

int main(int count, char** arguments) {
  const double seconds = count > 1 ? std::atof(arguments[1]) : 10.0;
  const std::uint64_t seed = count > 2 ? std::strtoull(arguments[2], nullptr, 10) : 1;
  std::fprintf(stderr, "fuzz_protocol: seed %llu\n", static_cast<unsigned long long>(seed));
  std::mt19937_64 noise(seed);
  const auto begin = std::chrono::steady_clock::now();
  std::uint64_t inputs = 0;
  std::uint64_t bytes = 0;
  while (std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() < seconds) {
    std::vector<std::uint8_t> input(noise() % 3000);
    const std::uint64_t wild = noise() % 4;  // steps of mostly blocks, or anything
    for (std::uint8_t& byte : input) {
      byte = static_cast<std::uint8_t>(wild == 0 || noise() % 8 == 0 ? noise() : noise() % 80);
    }
    static constexpr char kText[] = "tTdDbBrR0123456789ABCDEF\r\r\r\a";
    for (std::uint64_t place = noise() % 400; wild == 1 && place < input.size(); ++place) {
      input[place] = static_cast<std::uint8_t>(kText[noise() % (sizeof kText - 1)]);
    }
    LLVMFuzzerTestOneInput(input.data(), input.size());
    ++inputs;
    bytes += input.size();
  }
  std::printf("fuzz_protocol: %llu inputs, %llu bytes, %llu scans, no failure\n",
              static_cast<unsigned long long>(inputs), static_cast<unsigned long long>(bytes),
              static_cast<unsigned long long>(published));
  return published > 0 ? 0 : 1;
}

#endif
