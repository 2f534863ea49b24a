// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Text format of serial-line CAN adapters (slcan).
///
/// A line is a letter, the identifier (3 or 8 digits), the length code, and the data; it ends with \r. Letters: t T:
/// data frame with an 11-bit or 29-bit identifier; r R: remote frame; d D: CAN FD; b B: CAN FD with rate switch.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>

#include "posfet_core/protocol/frame.hpp"

namespace posfet::protocol {

constexpr std::uint8_t kLineEnd = '\r';

/// Reply of an adapter that rejects a line; ends a line like `kLineEnd`.
constexpr std::uint8_t kRefused = '\a';

/// Length of the longest line: header of 10, 64 bytes, time stamp of 4 digits.
constexpr std::size_t kLongestLine = 10 + 2 * kLongestFrame + 4;

/// A line without its end; one that was too long is cut, and no longer one of a frame.
struct Line {
  const std::uint8_t* text = nullptr;
  std::size_t length = 0;
};

/// A frame that was read from a line.
struct LineFrame {
  std::uint32_t identifier = 0;
  unsigned kind = kClassic;
  std::size_t length = 0;
  std::array<std::uint8_t, kLongestFrame> data{};

  Frame frame() const { return {identifier, kind, data.data(), length}; }
};

/// Read the frame of a line; return false for another line. A trailing time stamp is dropped.
bool parse_line(const Line& line, LineFrame& frame);

/// Splits a stream of bytes into lines and parses them into frames. Bytes may arrive in any pieces.
class LineReader {
public:
  /// Discard an unfinished line.
  void clear() { pending_ = 0; }

  /// Call `take(const Line&)` for each line that the bytes complete; a rejection is a line that ends with `kRefused`.
  template <typename Take>
  void split(const std::uint8_t* bytes, std::size_t size, Take&& take);

  /// Count a line that is no frame, or note what it says.
  void count(const Line& line);

  /// Call `take(const Frame&)` for the frame of each line that the bytes complete; count other lines.
  template <typename Take>
  void read(const std::uint8_t* bytes, std::size_t size, Take&& take) {
    split(bytes, size, [&](const Line& line) {
      if (parse_line(line, frame_)) {
        take(frame_.frame());
      } else {
        count(line);
      }
    });
  }

  /// Lines that are no frame, no reply and no acknowledgement.
  std::uint64_t malformed = 0;

  /// Lines that the adapter rejected.
  std::uint64_t refusals = 0;

  /// Replies to the command F together; whoever has read them clears it.
  std::optional<unsigned> flags;

private:
  /// Append bytes to the unfinished line, of which no more is kept than shows that it is too long.
  void append(const std::uint8_t* bytes, std::size_t size);

  std::array<std::uint8_t, kLongestLine + 1> rest_{};  ///< The unfinished line.
  std::size_t pending_ = 0;                            ///< Its length.
  LineFrame frame_;
};

template <typename Take>
void LineReader::split(const std::uint8_t* bytes, std::size_t size, Take&& take) {
  const std::uint8_t* const end = bytes + size;
  while (bytes != end) {
    const auto* stop =
        static_cast<const std::uint8_t*>(std::memchr(bytes, kLineEnd, static_cast<std::size_t>(end - bytes)));
    const auto span = static_cast<std::size_t>((stop != nullptr ? stop : end) - bytes);
    const auto* refused = static_cast<const std::uint8_t*>(std::memchr(bytes, kRefused, span));
    const std::uint8_t* next = nullptr;  // behind the end of this line
    std::size_t length = 0;
    if (refused != nullptr) {
      length = static_cast<std::size_t>(refused - bytes) + 1;
      next = bytes + length;
    } else if (stop != nullptr) {
      length = span;
      next = stop + 1;
    } else {
      append(bytes, span);
      break;
    }
    if (pending_ == 0) {
      take(Line{bytes, std::min(length, kLongestLine + 1)});
    } else {
      append(bytes, length);
      const std::size_t whole = pending_;
      pending_ = 0;
      take(Line{rest_.data(), whole});
    }
    bytes = next;
  }
  if (pending_ > kLongestLine) {
    ++malformed;
    rest_[0] = '?';  // invalidates the rest of this line
    pending_ = 1;
  }
}

}  // namespace posfet::protocol
