// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Counts of the last scans, from which faulty taxels are found at the end of a block.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "posfet_core/flags.hpp"

namespace posfet {

/// Rows of counts in the order of the scans; as many as fit. Of a board with more scans in a period the first ones are
/// kept, and the next row after the others is not `close`.
class CountHistory {
public:
  CountHistory(std::size_t scans, std::size_t taxels)
      : taxels_(taxels), counts_(scans * taxels, 0), close_(scans, false) {}

  std::size_t taxels() const { return taxels_; }
  std::size_t capacity() const { return close_.size(); }
  std::size_t filled() const { return filled_; }
  std::vector<std::uint16_t>& counts() { return counts_; }

  /// Whether a scan closely follows that in the row before, and none between them was left out.
  TaxelFlags& close() { return close_; }

  /// Keep the counts of a scan, unless there is no row left. Across a long gap (not `close`) counts change by more than
  /// their noise, as charge leaks.
  void add(const std::uint16_t* counts, bool close) {
    if (filled_ == capacity()) {
      left_out_ = true;
      return;
    }
    std::copy(counts, counts + taxels_, counts_.begin() + static_cast<std::ptrdiff_t>(filled_ * taxels_));
    close_[filled_] = close && !left_out_;
    left_out_ = false;
    ++filled_;
  }

  /// Keep the last rows only, at most `rows`, as the first ones.
  void keep(std::size_t rows) {
    const std::size_t kept = std::min(rows, filled_);
    const std::size_t from = filled_ - kept;
    std::copy(counts_.begin() + static_cast<std::ptrdiff_t>(from * taxels_),
              counts_.begin() + static_cast<std::ptrdiff_t>(filled_ * taxels_), counts_.begin());
    std::copy(close_.data() + from, close_.data() + filled_, close_.data());
    filled_ = kept;
  }

private:
  std::size_t taxels_;
  std::vector<std::uint16_t> counts_;
  TaxelFlags close_;
  std::size_t filled_ = 0;
  bool left_out_ = false;  ///< Whether scans were left out since the newest row.
};

}  // namespace posfet
