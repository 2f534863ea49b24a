// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Containers of what changes from scan to scan, whose memory is recycled: what one scan frees the next one takes, so
/// that in steady state nothing is allocated, and no lock is taken.
///
/// Each thread keeps blocks of powers of two, as many as were ever in use at once and some more, and frees them when it
/// ends. Under AddressSanitizer an access to a block that is not in use is found as in memory that was freed.
#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <map>
#include <new>
#include <set>
#include <utility>
#include <vector>

namespace posfet {

/// A block of at least some bytes, aligned for any type; throws std::bad_alloc.
void* take_block(std::size_t bytes);

/// Keep a block of that size for the next who takes one.
void give_block(void* block, std::size_t bytes) noexcept;

/// Allocator of recycled blocks.
template <typename Value>
class Recycler {
public:
  using value_type = Value;

  Recycler() = default;

  template <typename Other>
  Recycler(const Recycler<Other>& /*other*/) noexcept {}  // NOLINT(misc-explicit-constructor)

  Value* allocate(std::size_t count) {
    if (count > std::numeric_limits<std::size_t>::max() / (2 * sizeof(Value))) {
      throw std::bad_alloc();
    }
    return static_cast<Value*>(take_block(count * sizeof(Value)));
  }

  void deallocate(Value* block, std::size_t count) noexcept {
    give_block(static_cast<void*>(block), count * sizeof(Value));
  }

  template <typename Other>
  bool operator==(const Recycler<Other>& /*other*/) const noexcept {
    return true;
  }

  template <typename Other>
  bool operator!=(const Recycler<Other>& /*other*/) const noexcept {
    return false;
  }
};

template <typename Value>
using Vector = std::vector<Value, Recycler<Value>>;

template <typename Key, typename Value>
using Map = std::map<Key, Value, std::less<Key>, Recycler<std::pair<const Key, Value>>>;

template <typename Value>
using Set = std::set<Value, std::less<Value>, Recycler<Value>>;

}  // namespace posfet
