// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/block.hpp"

#include <utility>

namespace posfet {

Block::Block(std::size_t taxels, TouchResponse touch)
    : mean(taxels, 0.0),
      noise(taxels, 0.0),
      charge(taxels, 0.0),
      listed(taxels),
      touched(taxels),
      response(taxels * kSharedStates, 0.0),
      neighbour(taxels, 0.0),
      tail(taxels, 0.0),
      own_noise(taxels * kOwnStates * kOwnStates, 0.0),
      cooled(taxels, 0.0),
      before(taxels, kSharedStates),
      touch_before(std::move(touch)) {}

LastBlocks::LastBlocks(std::size_t taxels, const TouchResponse& touch) {
  for (std::size_t place = 0; place <= kLag; ++place) {
    places_.emplace_back(taxels, touch);
  }
}

double LastBlocks::duration() const {
  double duration = 0.0;
  for (std::size_t index = 0; index < size_; ++index) {
    duration += (*this)[index].duration;
  }
  return duration;
}

Vector<double> LastBlocks::times() const {
  Vector<double> times(size_);
  double time = 0.0;
  for (std::size_t index = 0; index < size_; ++index) {
    times[index] = time += (*this)[index].span;
  }
  return times;
}

void LastBlocks::push() {
  if (full()) {
    first_ = (first_ + 1) % places_.size();
  } else {
    ++size_;
  }
}

}  // namespace posfet
