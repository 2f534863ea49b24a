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

namespace posfet {

/// A fixed number of flags.
class TaxelFlags {
public:
  explicit TaxelFlags(std::size_t count = 0, bool value = false)
      : flags_(std::make_unique<bool[]>(count)), count_(count) {  // NOLINT(modernize-avoid-c-arrays)
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
  std::unique_ptr<bool[]> flags_;  // NOLINT(modernize-avoid-c-arrays)
  std::size_t count_;
};

}  // namespace posfet
