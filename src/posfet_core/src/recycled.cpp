// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/recycled.hpp"

#include <array>

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#else
#define ASAN_POISON_MEMORY_REGION(begin, size) ((void)(begin), (void)(size))
#define ASAN_UNPOISON_MEMORY_REGION(begin, size) ((void)(begin), (void)(size))
#endif

namespace posfet {

namespace {

/// Blocks of 2^5 = 32 bytes to 2^20, one MiB; larger ones come from the system.
constexpr std::size_t kSmallest = 32;
constexpr std::size_t kSizes = 16;
constexpr std::size_t kLargestSize = kSmallest << (kSizes - 1);

/// Smaller blocks are taken from the system so many bytes at once: the greatest number in use keeps growing for long,
/// always more slowly, and the end of a block of scans would allocate long after the first touches.
constexpr std::size_t kAtOnce = 4096;

/// A block that is not in use.
struct Free {
  Free* next;
};

class Blocks;

/// The blocks of this thread; null before it has any, and after it has freed them. Trivial, so that it can be read when
/// the thread ends.
thread_local Blocks* mine = nullptr;
thread_local bool ended = false;

/// Lists of the blocks that one thread keeps, by their size.
class Blocks {
public:
  Blocks() = default;

  Blocks(const Blocks&) = delete;
  Blocks& operator=(const Blocks&) = delete;

  ~Blocks() {
    mine = nullptr;
    ended = true;
    for (Free* block : lists_) {
      while (block != nullptr) {
        ASAN_UNPOISON_MEMORY_REGION(block, sizeof(Free));
        Free* next = block->next;
        ::operator delete(block);
        block = next;
      }
    }
  }

  Free*& list(std::size_t index) { return lists_[index]; }

private:
  std::array<Free*, kSizes> lists_{};
};

/// The blocks of this thread; null when it ends.
Blocks* blocks() {
  if (mine == nullptr && !ended) {
    thread_local Blocks own;
    mine = &own;
  }
  return mine;
}

/// The place of the list of the least size that holds some bytes, at most `kLargestSize`.
std::size_t index_of(std::size_t bytes) {
  std::size_t index = 0;
  while ((kSmallest << index) < bytes) {
    ++index;
  }
  return index;
}

}  // namespace

void* take_block(std::size_t bytes) {
  if (bytes > kLargestSize) {
    return ::operator new(bytes);
  }
  const std::size_t index = index_of(bytes);
  Blocks* const kept = blocks();
  if (kept != nullptr && kept->list(index) != nullptr) {
    Free* const block = kept->list(index);
    ASAN_UNPOISON_MEMORY_REGION(block, kSmallest << index);
    kept->list(index) = block->next;
    return block;
  }
  const std::size_t size = kSmallest << index;
  if (kept != nullptr) {
    for (std::size_t ahead = 2 * size; ahead <= kAtOnce; ahead += size) {
      give_block(::operator new(size), size);
    }
  }
  return ::operator new(size);
}

void give_block(void* block, std::size_t bytes) noexcept {
  Blocks* const kept = bytes > kLargestSize ? nullptr : blocks();
  if (kept == nullptr) {
    ::operator delete(block);
    return;
  }
  const std::size_t index = index_of(bytes);
  kept->list(index) = new (block) Free{kept->list(index)};
  ASAN_POISON_MEMORY_REGION(block, kSmallest << index);
}

}  // namespace posfet
