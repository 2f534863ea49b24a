// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// The newest values of a series.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace posfet::protocol {

/// The `Limit` newest values, the oldest first.
template <typename Value, std::size_t Limit>
class Recent {
public:
  /// Add a value; the oldest one makes room for it.
  void add(const Value& value) {
    if (size_ == Limit) {
      std::move(values_.begin() + 1, values_.end(), values_.begin());
      --size_;
    }
    values_[size_++] = value;
  }

  void clear() { size_ = 0; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  const Value& front() const { return values_.front(); }
  const Value* begin() const { return values_.data(); }
  const Value* end() const { return values_.data() + size_; }

private:
  std::array<Value, Limit> values_{};
  std::size_t size_ = 0;
};

}  // namespace posfet::protocol
