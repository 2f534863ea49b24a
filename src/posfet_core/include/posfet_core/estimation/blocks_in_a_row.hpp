// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Contacts that have looked the same for some blocks in a row.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Counts for each taxel in how many blocks in a row the contact that it is in has looked some way.
class BlocksInARow {
public:
  BlocksInARow(std::size_t taxels, std::size_t enough) : enough_(enough), counts_(taxels, 0) {}

  void reset() { std::fill(counts_.begin(), counts_.end(), 0); }

  /// Process a block: mark the taxels whose contacts have looked so in enough blocks, by whether one does in this
  /// block. Returns whether there are any.
  template <typename Looks>
  bool update(const Vector<const Taxels*>& contacts, Looks looks, bool* marked) {
    std::fill(marked, marked + counts_.size(), false);
    for (const Taxels* contact : contacts) {
      const bool now = looks(*contact);
      for (const Taxel taxel : *contact) {
        marked[taxel] = now;
      }
    }
    bool any = false;
    for (std::size_t taxel = 0; taxel < counts_.size(); ++taxel) {
      counts_[taxel] = marked[taxel] ? counts_[taxel] + 1 : 0;
      marked[taxel] = counts_[taxel] >= enough_;
      any = any || marked[taxel];
    }
    return any;
  }

private:
  std::size_t enough_;
  std::vector<std::size_t> counts_;
};

}  // namespace posfet
