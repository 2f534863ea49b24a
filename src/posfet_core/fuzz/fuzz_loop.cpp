// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// Gives the loop random bytes in random pieces, by a stream of lines and by datagrams, and calls it from two threads.
///
/// A step sends bytes, the frames of scans, or runs the loop, with a sink that takes, refuses or ends; a batch that the
/// loop hands back is taken as a reader takes it. It ends at undefined behaviour, at an access outside of an object,
/// and when memory is allocated after the start. Then one thread runs the loop while another sends scans, and a third
/// one wakes it and looks at its counters: no scan may be handed on between `wake` and the next call. Built with a
/// sanitizer of threads, and called with 0 seconds, it shows what is not locked. `fuzz_loop SECONDS SEED`.

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <new>
#include <random>
#include <thread>

#include "posfet_core/protocol/kernel_frame.hpp"
#include "posfet_core/protocol/scan_loop.hpp"

namespace {

std::atomic<std::uint64_t> allocated{0};

}  // namespace

// Not inlined: compilers take free() for a mistake there.
__attribute__((noinline)) void* operator new(std::size_t size) {
  ++allocated;
  if (void* memory = std::malloc(size == 0 ? 1 : size)) {
    return memory;
  }
  throw std::bad_alloc();
}

__attribute__((noinline)) void operator delete(void* memory) noexcept { std::free(memory); }
__attribute__((noinline)) void operator delete(void* memory, std::size_t /*size*/) noexcept { std::free(memory); }

namespace posfet::protocol {

namespace {

constexpr std::uint32_t kBase = 0x100;
constexpr std::size_t kTaxels = 25;
constexpr int kRounds = 300;

[[noreturn]] void fail(const char* reason) {
  std::fprintf(stderr, "fuzz_loop: %s\n", reason);
  std::abort();
}

void require(bool condition, const char* reason) {
  if (!condition) {
    fail(reason);
  }
}

/// A loop at one end of a pair of sockets; what is written to the other end is read by it.
class Bench {
public:
  explicit Bench(bool lines)
      : lines_(lines),
        decoder_({true, kTaxels}, kBase),
        port_(lines ? std::unique_ptr<FramePort>(std::make_unique<LinePort>(near(), reader_))
                    : std::unique_ptr<FramePort>(std::make_unique<SocketPort>(near()))),
        loop_(decoder_, *port_, control_, arrival_time_) {
    decoder_.start();
  }

  ~Bench() {
    close(ends_[0]);
    close(ends_[1]);
  }

  Bench(const Bench&) = delete;
  Bench& operator=(const Bench&) = delete;

  /// Write bytes; what has no room is lost.
  void write(const std::uint8_t* bytes, std::size_t size) const {
    [[maybe_unused]] const ssize_t written = send(ends_[1], bytes, size, MSG_DONTWAIT | MSG_NOSIGNAL);
  }

  /// Write the frame of the next scan; of a line, no more than `most` bytes.
  void write_scan(std::size_t most) {
    std::array<std::uint8_t, kLongestFrame> data{};
    const std::uint32_t sequence = sequence_++;
    const std::uint32_t time = 1000 * sequence;
    std::memcpy(data.data(), &sequence, sizeof sequence);
    std::memcpy(data.data() + 4, &time, sizeof time);
    const std::uint16_t checksum = fd_checksum(data.data());
    std::memcpy(data.data() + 10, &checksum, sizeof checksum);
    if (lines_) {
      std::array<char, 10 + 2 * kLongestFrame> line{};
      int length = std::snprintf(line.data(), line.size(), "b%03XF", kBase + kFdBlockOffset);
      for (const std::uint8_t byte : data) {
        length += std::snprintf(line.data() + length, line.size() - static_cast<std::size_t>(length), "%02X", byte);
      }
      line[static_cast<std::size_t>(length)] = '\r';
      const std::size_t size = static_cast<std::size_t>(length) + 1;
      write(reinterpret_cast<const std::uint8_t*>(line.data()), most < size ? most : size);
    } else {
      std::array<std::uint8_t, kKernelFdFrame> frame{};
      const std::uint32_t identifier = kBase + kFdBlockOffset;
      std::memcpy(frame.data(), &identifier, sizeof identifier);
      frame[4] = kLongestFrame;
      frame[5] = 1;
      std::memcpy(frame.data() + kKernelHeader, data.data(), data.size());
      write(frame.data(), frame.size());
    }
  }

  /// Run the loop, and do with the result what a caller does; return how it has ended.
  LoopEnd run(const ScanSink& sink, std::int64_t timeout) {
    const LoopEnd end = loop_.run(sink, {}, monotonic_now() + timeout);
    if (end == LoopEnd::kMessage) {
      const Frame message = loop_.message();
      checksum_ += message.length > 0 ? message.data[message.length - 1] : 0U;
    } else if (end == LoopEnd::kHanded) {
      require(port_->take_handed_back(), "what was handed back must be there");
      reader_.flags.reset();
      for (const StoredFrame& frame : port_->frames()) {
        checksum_ += frame.identifier;
      }
    }
    return end;
  }

  void drain() {
    LoopEnd found = LoopEnd::kTimeout;
    while (loop_.advance(found)) {
    }
    require(!loop_.pending(), "nothing may be left of a batch");
  }

  LoopControl& control() { return control_; }
  const BoardDecoder& decoder() const { return decoder_; }
  const ScanLoop& loop() const { return loop_; }

private:
  int near() {
    require(socketpair(AF_UNIX, lines_ ? SOCK_STREAM : SOCK_DGRAM, 0, ends_.data()) == 0, "no sockets");
    fcntl(ends_[0], F_SETFL, O_NONBLOCK);
    return ends_[0];
  }

  bool lines_;
  std::array<int, 2> ends_{};
  BoardDecoder decoder_;
  LineReader reader_;
  LoopControl control_;
  ArrivalTime arrival_time_;
  std::unique_ptr<FramePort> port_;
  ScanLoop loop_;
  std::uint32_t sequence_ = 0;
  std::uint64_t checksum_ = 0;
};

/// Takes scans as random numbers say.
struct RandomSink {
  std::mt19937_64 noise;
  std::uint64_t scans = 0;

  ScanSink sink() {
    return {this, [](void* self, const Scan& scan) {
              auto& own = *static_cast<RandomSink*>(self);
              require(scan.taxels == kTaxels, "a scan must have all taxels");
              ++own.scans;
              const std::uint64_t what = own.noise() % 16;
              return what == 0 ? Taken::kRefused : what == 1 ? Taken::kLast : Taken::kTaken;
            }};
  }
};

/// Make random steps; return the number of scans.
std::uint64_t fuzz(std::mt19937_64& noise) {
  Bench bench(noise() % 2 == 0);
  RandomSink random{std::mt19937_64(noise())};
  const ScanSink sink = random.sink();
  static constexpr char kText[] = "tTdDbBrRF0123456789ABCDEF\r\r\r\a";
  std::array<std::uint8_t, 3000> bytes{};
  const std::uint64_t before = allocated;
  for (int step = 0; step < 300; ++step) {
    switch (noise() % 8) {
      case 0: {
        const std::size_t size = noise() % bytes.size();
        const bool text = noise() % 2 == 0;
        for (std::size_t place = 0; place < size; ++place) {
          bytes[place] = text ? static_cast<std::uint8_t>(kText[noise() % (sizeof kText - 1)])
                              : static_cast<std::uint8_t>(noise());
        }
        bench.write(bytes.data(), noise() % 2 == 0 ? size : size % (kKernelFdFrame + 1));
        break;
      }
      case 1:
        bench.write_scan(noise() % 200);
        break;
      case 2:
        bench.control().wake();
        break;
      case 3:
        bench.drain();
        break;
      case 4:
        bench.run(sink, 0);
        break;
      default:
        bench.write_scan(kLongestLine);
    }
  }
  while (bench.run(sink, 0) != LoopEnd::kTimeout) {
  }
  require(allocated == before, "memory was allocated");
  return random.scans;
}

/// Takes all scans, while it may.
struct WatchedSink {
  std::atomic<bool> forbidden{false};
  std::uint64_t scans = 0;

  ScanSink sink() {
    return {this, [](void* self, const Scan& /*scan*/) {
              auto& own = *static_cast<WatchedSink*>(self);
              require(!own.forbidden, "a scan was handed on after waking");
              ++own.scans;
              return Taken::kTaken;
            }};
  }
};

/// Run the loop in a thread that another one wakes, while scans arrive; return the number of scans.
std::uint64_t race(bool lines, int rounds) {
  Bench bench(lines);
  WatchedSink watched;
  std::atomic<bool> stop{false};
  std::atomic<int> paused{0};
  std::atomic<int> resumed{0};
  std::thread sender([&] {
    while (!stop) {
      bench.write_scan(kLongestLine);
      std::this_thread::yield();
    }
  });
  std::thread reader([&] {
    while (!stop) {
      if (bench.run(watched.sink(), 1'000'000) == LoopEnd::kWoken) {
        ++paused;
        while (!stop && resumed < paused) {
          std::this_thread::yield();
        }
      }
    }
  });
  Counter seen = 0;
  for (int round = 0; round < rounds; ++round) {
    bench.control().wake();
    watched.forbidden = true;
    for (int look = 0; look < 3; ++look) {
      const std::scoped_lock lock(bench.control().mutex());
      require(bench.decoder().scans() >= seen, "the counters must rise");
      seen = bench.decoder().scans();
    }
    while (paused <= round) {
      std::this_thread::yield();
    }
    watched.forbidden = false;
    ++resumed;
    const std::uint64_t target = seen + 1;
    for (bool more = true; more; std::this_thread::yield()) {
      const std::scoped_lock lock(bench.control().mutex());
      more = bench.decoder().scans() < target;
    }
  }
  stop = true;
  bench.control().wake();
  sender.join();
  reader.join();
  require(watched.scans > 0 && bench.loop().taken() == watched.scans, "scans must be taken");
  return watched.scans;
}

}  // namespace

}  // namespace posfet::protocol

int main(int count, char** arguments) {
  using namespace posfet::protocol;
  const double seconds = count > 1 ? std::atof(arguments[1]) : 10.0;
  const std::uint64_t seed = count > 2 ? std::strtoull(arguments[2], nullptr, 10) : 1;
  std::fprintf(stderr, "fuzz_loop: seed %llu\n", static_cast<unsigned long long>(seed));
  std::mt19937_64 noise(seed);
  std::uint64_t stories = 0;
  std::uint64_t scans = 0;
  const auto begin = std::chrono::steady_clock::now();
  while (std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() < seconds) {
    scans += fuzz(noise);
    ++stories;
  }
  const std::uint64_t raced = race(true, kRounds) + race(false, kRounds);
  std::printf("fuzz_loop: %llu stories, %llu scans; %llu scans with three threads, no failure\n",
              static_cast<unsigned long long>(stories), static_cast<unsigned long long>(scans),
              static_cast<unsigned long long>(raced));
  return 0;
}
