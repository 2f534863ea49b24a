// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// Reads a bus, decodes it, and hands each scan to what takes scans, in one call without an interpreter.
///
/// The loop is for a board that sends scans and is otherwise quiet; whatever else there is ends the call. What a batch
/// holds beyond that is processed by the next call, or by `advance` without a sink. A batch that brought more than
/// frames of nodes is not decoded: the port hands it to whoever reads it next.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "posfet_core/protocol/arrival_time.hpp"
#include "posfet_core/protocol/board_decoder.hpp"
#include "posfet_core/protocol/frame_port.hpp"
#include "posfet_core/protocol/loop_control.hpp"
#include "posfet_core/scan_sink.hpp"

namespace posfet::protocol {

/// Why a call of the loop has ended.
enum class LoopEnd : std::uint8_t {
  kScan,     ///< The sink has refused a scan: it is the newest one of the decoder.
  kMessage,  ///< A status, a response or an identity: `message`.
  kLast,     ///< The sink took a scan and wants no more now.
  kHanded,   ///< The port has handed back a batch, or has failed.
  kWoken,
  kTimeout,
  kInterrupted,  ///< By a signal.
};

/// What a scan has that no frame carries, and the decoder does not know.
struct ScanContext {
  std::uint64_t layout = 0;             ///< Identifier of the layout.
  const float* temperatures = nullptr;  ///< Of the newest status [degC].
  std::size_t sensors = 0;              ///< Number of these.
};

/// The loop of one port and one board; everything that it refers to belongs to the caller.
class ScanLoop {
public:
  ScanLoop(BoardDecoder& decoder, FramePort& port, LoopControl& control, ArrivalTime& arrival_time)
      : decoder_(decoder), port_(port), control_(control), arrival_time_(arrival_time) {}

  /// Process what is left of a batch, then what arrives up to the monotonic time `end` [ns].
  LoopEnd run(const ScanSink& sink, const ScanContext& context, std::int64_t end);

  /// Process what is left of a batch, without a sink; return false at its end.
  bool advance(LoopEnd& found);

  /// Whether a batch was begun and not ended.
  bool pending() const { return pending_; }

  /// The frame of a message that has ended a call.
  Frame message() const { return port_.frames()[next_ - 1].frame(); }

  /// Monotonic time after the newest read [ns].
  std::int64_t arrival() const { return arrival_; }

  /// Wall time less monotonic time at the newest read [ns].
  std::int64_t wall_offset() const { return wall_offset_; }

  /// Scans that sinks have taken.
  std::uint64_t taken() const { return taken_; }

  /// Call `take(kind, length, number)` for the frames of each kind and length since the call before, of ended batches.
  template <typename Take>
  void take_frame_counts(Take&& take) {
    for (unsigned kind = 0; kind < frame_counts_.size(); ++kind) {
      for (std::size_t length = 0; length < frame_counts_[kind].size(); ++length) {
        std::uint32_t& number = frame_counts_[kind][length];
        if (number > 0) {
          take(kind, length, number);
          number = 0;
        }
      }
    }
  }

private:
  static constexpr std::size_t kKinds = std::size_t{2} * kRateSwitch;

  bool process(const ScanSink& sink, const ScanContext& context, LoopEnd& found);
  bool is_complete();
  Taken hand_on(const ScanSink& sink, const ScanContext& context) const;
  bool read();
  void end_batch();

  BoardDecoder& decoder_;
  FramePort& port_;
  LoopControl& control_;
  ArrivalTime& arrival_time_;
  bool pending_ = false;
  bool complete_ = false;   ///< Whether the frame before has completed a scan that was not handed on.
  bool releasing_ = false;  ///< Whether scans that were held may have been released.
  std::size_t next_ = 0;    ///< Index of the next frame of the batch.
  std::int64_t arrival_ = 0;
  std::int64_t wall_offset_ = 0;
  std::uint64_t taken_ = 0;
  std::array<std::array<std::uint32_t, kLongestFrame + 1>, kKinds> frame_counts_{};
};

}  // namespace posfet::protocol
