// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Flags in memory that can be shared with NumPy, which std::vector<bool> cannot.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>

#include "posfet_core/recycled.hpp"

namespace posfet {

/// A fixed number of flags, in recycled memory.
class TaxelFlags {
public:
  explicit TaxelFlags(std::size_t count = 0, bool value = false)
      : flags_(static_cast<bool*>(take_block(count)), Giver{count}), count_(count) {
    std::fill(data(), data() + count, value);
  }

  std::size_t size() const { return count_; }
  bool* data() { return flags_.get(); }
  const bool* data() const { return flags_.get(); }
  bool& operator[](std::size_t index) { return flags_[index]; }
  const bool& operator[](std::size_t index) const { return flags_[index]; }

  /// Set the flags to those of an array of the same size.
  void set(const bool* flags) { std::copy(flags, flags + count_, data()); }

  /// Set all flags to one value.
  void fill(bool value) { std::fill(data(), data() + count_, value); }

  bool any() const {
    return std::any_of(data(), data() + count_, [](bool flag) { return flag; });
  }

  bool all() const {
    return std::all_of(data(), data() + count_, [](bool flag) { return flag; });
  }

private:
  struct Giver {
    void operator()(bool* flags) const noexcept { give_block(flags, count); }
    std::size_t count;
  };

  std::unique_ptr<bool[], Giver> flags_;  // NOLINT(modernize-avoid-c-arrays)
  std::size_t count_;
};

/// Sum of the values of the taxels marked.
template <typename Values>
double sum_where(const TaxelFlags& where, const Values& values) {
  double sum = 0.0;
  for (std::size_t taxel = 0; taxel < where.size(); ++taxel) {
    sum += where[taxel] ? values[taxel] : 0.0;
  }
  return sum;
}

}  // namespace posfet
