// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/slcan.hpp"

namespace posfet::protocol {

namespace {

constexpr std::size_t kStandardDigits = 3;
constexpr std::size_t kExtendedDigits = 8;
constexpr std::size_t kTimestamp = 4;
constexpr std::size_t kFlagsLength = 3;
constexpr std::size_t kClassicCodes = 9;
constexpr std::uint32_t kHighestStandard = 0x7FF;
constexpr std::uint32_t kHighestExtended = 0x1FFF'FFFF;

/// What is no hexadecimal digit; its high bits are set in any number that contains it.
constexpr std::uint8_t kNoDigit = 0xF0;

/// Data length [byte] of each length code of CAN FD.
constexpr std::array<std::size_t, 16> kLengths = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

constexpr std::array<std::uint8_t, 256> digits() {
  std::array<std::uint8_t, 256> values{};
  for (std::size_t character = 0; character < values.size(); ++character) {
    if (character >= '0' && character <= '9') {
      values[character] = static_cast<std::uint8_t>(character - '0');
    } else if ((character | 0x20U) >= 'a' && (character | 0x20U) <= 'f') {
      values[character] = static_cast<std::uint8_t>((character | 0x20U) - 'a' + 10);
    } else {
      values[character] = kNoDigit;
    }
  }
  return values;
}

constexpr std::array<std::uint8_t, 256> kDigits = digits();

/// Read a number of `count` digits; return whether all of them are digits.
bool parse_number(const std::uint8_t* text, std::size_t count, std::uint32_t& number) {
  unsigned strange = 0;
  number = 0;
  for (std::size_t index = 0; index < count; ++index) {
    const unsigned digit = kDigits[text[index]];
    strange |= digit;
    number = number << 4U | (digit & 0xFU);
  }
  return strange < kNoDigit;
}

/// Read `count` bytes, of two digits each; return whether all of them are digits.
bool parse_bytes(const std::uint8_t* text, std::size_t count, std::uint8_t* bytes) {
  unsigned strange = 0;
  for (std::size_t index = 0; index < count; ++index) {
    const unsigned high = kDigits[text[2 * index]];
    const unsigned low = kDigits[text[2 * index + 1]];
    strange |= high | low;
    bytes[index] = static_cast<std::uint8_t>(high << 4U | (low & 0xFU));
  }
  return strange < kNoDigit;
}

std::optional<unsigned> kind_of(std::uint8_t letter) {
  const unsigned extended = letter < 'a' ? kExtended : 0U;
  switch (letter | 0x20U) {
    case 't':
      return extended;
    case 'r':
      return extended | kRemote;
    case 'd':
      return extended | kFd;
    case 'b':
      return extended | kFd | kRateSwitch;
    default:
      return std::nullopt;
  }
}

bool is_acknowledgement(const Line& line) {
  return line.length == 0 || (line.length == 1 && (line.text[0] | 0x20U) == 'z');
}

}  // namespace

bool parse_line(const Line& line, LineFrame& frame) {
  if (line.length <= kStandardDigits + 1) {
    return false;
  }
  const std::optional<unsigned> kind = kind_of(line.text[0]);
  if (!kind) {
    return false;
  }
  const bool extended = *kind & kExtended;
  const std::size_t code_at = 1 + (extended ? kExtendedDigits : kStandardDigits);
  std::uint32_t code = 0;
  if (line.length <= code_at || !parse_number(line.text + 1, code_at - 1, frame.identifier) ||
      !parse_number(line.text + code_at, 1, code)) {
    return false;
  }
  const bool fits = frame.identifier <= (extended ? kHighestExtended : kHighestStandard);
  if (!fits || (!(*kind & kFd) && code >= kClassicCodes)) {
    return false;
  }
  frame.kind = *kind;
  frame.length = kLengths[code];
  const std::size_t header = code_at + 1;
  const std::size_t end = *kind & kRemote ? header : header + 2 * frame.length;
  if (line.length != end && line.length != end + kTimestamp) {
    return false;
  }
  if (*kind & kRemote) {
    std::fill_n(frame.data.begin(), frame.length, std::uint8_t{0});
    return true;
  }
  return parse_bytes(line.text + header, frame.length, frame.data.data());
}

void LineReader::count(const Line& line) {
  if (is_acknowledgement(line)) {
    return;
  }
  if (line.length == 1 && line.text[0] == kRefused) {
    ++refusals;
    return;
  }
  std::uint8_t replied = 0;
  if (line.length == kFlagsLength && line.text[0] == 'F' && parse_bytes(line.text + 1, 1, &replied)) {
    flags = flags.value_or(0U) | replied;
    return;
  }
  ++malformed;
}

void LineReader::append(const std::uint8_t* bytes, std::size_t size) {
  const std::size_t kept = std::min(size, rest_.size() - pending_);
  std::copy_n(bytes, kept, rest_.begin() + static_cast<std::ptrdiff_t>(pending_));
  pending_ += kept;
}

}  // namespace posfet::protocol
