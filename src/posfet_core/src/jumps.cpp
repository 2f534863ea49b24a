// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/jumps.hpp"

#include <algorithm>
#include <cmath>

namespace posfet {

JumpDetector::JumpDetector(Taxel taxels, double least) {
  const auto count = static_cast<std::size_t>(taxels);
  limit_.assign(count, least);
  for (auto* values : {&charge_, &change_, &jump_, &last_, &before_, &refused_}) {
    values->assign(count, 0.0);
  }
  for (auto* mask : {&jumped_, &fresh_, &moved_}) {
    mask->assign(count, 0);
  }
}

void JumpDetector::set_limits(const double* limits) { limit_.assign(limits, limits + limit_.size()); }

bool JumpDetector::examine(const double* charge, bool adjacent, const bool* faulty) {
  bool any_fresh = false;
  for (std::size_t taxel = 0; taxel < last_.size(); ++taxel) {
    charge_[taxel] = charge[taxel];
    const double change = charge[taxel] - last_[taxel];
    jump_[taxel] = change - before_[taxel];
    change_[taxel] = adjacent ? change : 0.0;
    jumped_[taxel] = adjacent && std::abs(jump_[taxel]) > limit_[taxel] && !faulty[taxel];
    fresh_[taxel] = jumped_[taxel] && !moved_[taxel];
    any_fresh = any_fresh || fresh_[taxel];
  }
  if (any_fresh && !persists()) {
    return true;
  }
  accept();
  return false;
}

void JumpDetector::accept() {
  moved_ = jumped_;
  last_ = charge_;
  before_ = change_;
  in_a_row_ = 0;
}

void JumpDetector::refuse() {
  for (std::size_t taxel = 0; taxel < refused_.size(); ++taxel) {
    refused_[taxel] = jumped_[taxel] ? jump_[taxel] : 0.0;
  }
  ++in_a_row_;
}

/// Whether the jump that was refused in the last scan is still there, or too many were refused.
bool JumpDetector::persists() const {
  if (in_a_row_ == 0) {
    return false;
  }
  bool all_left = true;
  for (std::size_t taxel = 0; taxel < refused_.size(); ++taxel) {
    all_left = all_left && jump_[taxel] * refused_[taxel] >= kPersisting * refused_[taxel] * refused_[taxel];
  }
  return in_a_row_ >= kMostInARow || all_left;
}

}  // namespace posfet
