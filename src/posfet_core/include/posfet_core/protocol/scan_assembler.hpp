// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Collects the blocks of one scan at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "posfet_core/protocol/scan_format.hpp"
#include "posfet_core/protocol/scan_statistics.hpp"

namespace posfet::protocol {

/// Effect of one block on the scan being assembled.
enum class BlockOutcome : std::uint8_t {
  kCollected,
  kComplete,  ///< The block completed the scan.
  kIgnored,   ///< A duplicate, or a block of an abandoned scan.
  kConflict,  ///< The block repeats an index of the scan with other data: two scans share one counter.
};

/// Collects the blocks of one scan at a time.
///
/// `FdScans` or `ClassicScans` decides which scan a block belongs to. Boards send scans in order, so the current scan
/// is abandoned when a later one begins.
class Assembler {
public:
  explicit Assembler(const ScanFormat& format);

  const ScanFormat& format() const { return format_; }
  std::size_t blocks() const { return blocks_; }

  /// Counts of the last complete scan, shape [taxels]; they stay where they are.
  std::vector<std::uint16_t>& counts() { return counts_; }
  const std::vector<std::uint16_t>& counts() const { return counts_; }

  /// Status of the current scan, from the block that arrived last: 4 bits of ScanStatus.
  unsigned status() const { return status_; }

  /// Whether the current scan is complete.
  bool complete() const { return number_ == blocks_ && !abandoned_; }

  /// Begin the next scan; the current one is counted if it is incomplete.
  void begin();

  /// Add one block, of an index in [0, blocks), with status bits and the `block_length` bytes of its frame.
  ///
  /// Returns `kComplete` when this block completed the scan: `counts` holds it.
  BlockOutcome add(std::size_t block, unsigned status, const std::uint8_t* data);

  /// Abandon the current scan; it is counted if it is incomplete.
  void abandon();

  /// Count scans of which no block arrived.
  void count_lost(Counter scans);

  ScanStatistics statistics;

private:
  void give_up();
  void forget_blocks();
  void take(std::size_t block, const std::uint8_t* data);

  ScanFormat format_;
  std::size_t blocks_;
  std::size_t length_;  ///< Of a block [byte].
  std::vector<std::uint16_t> counts_;
  std::vector<std::uint8_t> wire_;      ///< Data of the blocks.
  std::vector<std::uint8_t> received_;  ///< Whether each block of the current scan arrived.
  std::size_t number_ = 0;              ///< Of blocks that arrived.
  std::size_t behind_ = 0;              ///< Behind the last of the blocks that arrived.
  unsigned status_ = 0;
  bool abandoned_ = true;  ///< No scan is being collected.
};

}  // namespace posfet::protocol
