// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// Reads the frames that wait at a file descriptor: the lines of a serial port, or a SocketCAN socket.
///
/// A thread calls `wait`, `receive`, `parse`; then `frames` are those of one batch until the next `receive`. Only
/// `parse` changes what other threads may look at, such as counters. Nothing is allocated after construction.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "posfet_core/protocol/slcan.hpp"

namespace posfet::protocol {

/// A frame with its data.
using StoredFrame = LineFrame;

/// What waiting has brought.
enum class Waited : std::uint8_t { kReadable, kWoken, kTimeout, kInterrupted };

/// Wait until a descriptor can be read, or has failed, or another is readable (negative: there is none), up to a
/// monotonic time [ns]; a signal interrupts it.
Waited wait_until(int descriptor, int wake, std::int64_t end);

/// This machine's monotonic time and wall time [ns].
std::int64_t monotonic_now();
std::int64_t wall_now();

/// Frames of a file descriptor, which does not block and belongs to the caller.
class FramePort {
public:
  FramePort(int descriptor, std::size_t capacity) : descriptor_(descriptor) { frames_.reserve(capacity); }
  virtual ~FramePort() = default;

  FramePort(const FramePort&) = delete;
  FramePort& operator=(const FramePort&) = delete;

  /// Read what is waiting; return false when there was nothing.
  virtual bool receive() = 0;

  /// Make `frames` of what was received.
  virtual void parse() = 0;

  /// Whether the batch brought more than frames of nodes: an error frame, flags of the adapter, frames dropped.
  virtual bool remarkable() const = 0;

  int descriptor() const { return descriptor_; }
  const std::vector<StoredFrame>& frames() const { return frames_; }

  /// Wall time at which the newest frame arrived [ns], by the kernel; 0: unknown.
  std::int64_t stamp() const { return stamp_; }

  /// Forget the batch: nothing came.
  void forget() {
    frames_.clear();
    stamp_ = 0;
  }

  /// Leave the batch, or the failure, to whoever reads next.
  void hand_back() { handed_back_ = true; }
  bool take_handed_back() { return std::exchange(handed_back_, false); }

  /// Error number of a read that failed; 0: none, or the end of the file.
  int error() const { return error_; }
  bool ended() const { return ended_; }
  bool failed() const { return ended_ || error_ != 0; }

protected:
  std::vector<StoredFrame>& storage() { return frames_; }
  void set_stamp(std::int64_t stamp) { stamp_ = stamp; }

  /// Note the result of a read that has failed: nothing was waiting, an error, or the end of the file (`size` 0).
  void note(std::ptrdiff_t size);
  void clear_failure();

private:
  int descriptor_;
  std::vector<StoredFrame> frames_;
  std::int64_t stamp_ = 0;
  int error_ = 0;
  bool ended_ = false;
  bool handed_back_ = false;
};

/// The lines of an slcan adapter.
class LinePort : public FramePort {
public:
  /// Largest number of bytes read at once.
  static constexpr std::size_t kReadSize = std::size_t{1} << 14U;

  /// Length of the shortest line of a frame, with its end [byte].
  static constexpr std::size_t kShortestLine = 6;

  /// The reader holds the unfinished line, the counters, and the flags of the adapter.
  LinePort(int descriptor, LineReader& reader);

  bool receive() override;
  void parse() override;
  bool remarkable() const override { return reader_.flags.has_value(); }

private:
  LineReader& reader_;
  std::array<std::uint8_t, kReadSize> bytes_{};
  std::size_t size_ = 0;
};

/// A SocketCAN socket.
class SocketPort : public FramePort {
public:
  /// Largest number of frames read at once.
  static constexpr std::size_t kReadLimit = 1024;

  explicit SocketPort(int descriptor) : FramePort(descriptor, kReadLimit) {}

  bool receive() override;
  void parse() override {}
  bool remarkable() const override { return remarkable_; }

  /// Frames that the kernel has dropped for lack of room since the socket was opened.
  std::uint32_t dropped() const { return dropped_; }

private:
  std::uint32_t dropped_ = 0;
  bool remarkable_ = false;
};

}  // namespace posfet::protocol
