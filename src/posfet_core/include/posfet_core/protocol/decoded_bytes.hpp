// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// From the bytes of a bus to the scans and messages of a board, without a list of frames between them.
///
/// A thread without Python calls, for all that it has read at one time,
///
///     decoder.begin_batch(arrival, wall_offset);
///     decode_lines(lines, decoder, bytes, size, sink);   // of a slcan adapter, in any pieces; or for each frame
///     decode_kernel_frame(decoder, bytes, size, sink);   // what one read of a SocketCAN socket has returned
///     decoder.end_batch();
///
/// The sink is called in the order of arrival, and uses its arguments before it returns:
///
///     void scan(const CompleteScan& scan, const std::vector<std::uint16_t>& counts);
///     void message(Found found, const Frame& frame);  // a status, a response or an identity
///     void error(const Frame& frame);                 // an error frame, which concerns the bus
///
/// Status flags of an adapter are no frames: `lines.flags`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "posfet_core/protocol/board_decoder.hpp"
#include "posfet_core/protocol/frame.hpp"
#include "posfet_core/protocol/kernel_frame.hpp"
#include "posfet_core/protocol/slcan.hpp"

namespace posfet::protocol {

/// Decode one frame of the batch.
template <typename Sink>
void decode_frame(BoardDecoder& decoder, const Frame& frame, Sink& sink) {
  ++decoder.traffic.frames;
  if (frame.kind & kError) {
    sink.error(frame);
  }
  switch (const Found found = decoder.feed(frame)) {
    case Found::kNothing:
      break;
    case Found::kScan:
      sink.scan(decoder.scan(), decoder.assembler().counts());
      break;
    case Found::kReleased:
      while (decoder.release()) {
        sink.scan(decoder.scan(), decoder.assembler().counts());
      }
      break;
    case Found::kStatus:
    case Found::kResponse:
    case Found::kIdentity:
      sink.message(found, frame);
      break;
  }
}

/// Decode the frames of the lines that some bytes of an adapter complete.
template <typename Sink>
void decode_lines(LineReader& lines, BoardDecoder& decoder, const std::uint8_t* bytes, std::size_t size, Sink& sink) {
  lines.read(bytes, size, [&decoder, &sink](const Frame& frame) { decode_frame(decoder, frame, sink); });
}

/// Decode the frame that one read of a socket has returned; return false when the bytes are too few for one.
template <typename Sink>
bool decode_kernel_frame(BoardDecoder& decoder, const std::uint8_t* bytes, std::size_t size, Sink& sink) {
  const auto frame = parse_kernel_frame(bytes, size);
  if (frame) {
    decode_frame(decoder, *frame, sink);
  }
  return frame.has_value();
}

}  // namespace posfet::protocol
