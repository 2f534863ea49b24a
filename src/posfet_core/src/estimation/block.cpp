// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/block.hpp"

#include <algorithm>
#include <utility>

namespace posfet {

namespace {

/// Least time constant of the leakage that is believed, relative to that of the calibration at its temperature [1].
constexpr double kLeastLeak = 0.5;

}  // namespace

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

TouchResponse::Known known_errors(const Belief& belief, const Passage& block) {
  return {std::max(1.0 + belief.shared[kLeak], kLeastLeak) / block.leak - 1.0, belief.shared[kWarmth]};
}

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
