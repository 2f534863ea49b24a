// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/witnesses.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/estimation/zero_refutation.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Least share of its warmth that a taxel keeps in a block [1]: not 0, for the logarithm.
constexpr double kLeastLeft = 1e-9;

}  // namespace

Witness::Witness(std::size_t taxels)
    : before(taxels, kSharedStates), filter(std::make_shared<Belief>(0, kSharedStates)) {}

Witnesses::Witnesses(std::size_t taxels, const TouchResponse& touch)
    : noise_(taxels * kOwnStates * kOwnStates, 0.0), cooled_(taxels, 0.0), passed_(taxels, touch) {
  for (std::size_t count = 0; count < kCount; ++count) {
    witnesses_.emplace_back(taxels);
  }
}

void Witnesses::clear() {
  size_ = 0;
  passages_.clear();
  begun_ = Passage();
}

void Witnesses::follow(const Block& block, Propagation& propagation) {
  pass(block);
  Witness* witness = behind();
  if (witness == nullptr) {
    return;
  }
  static_cast<Passage&>(passed_) = passages_[witness->next];
  propagation.predict(witness->filter, passed_);
  const auto found = propagation.measure_temperature(witness->filter, passed_, false);
  witness->evidence += passed_.unlikely - (found.square + found.spread);
  ++witness->next;
  if (found.square > square(kSurprising)) {
    clear();
  }
}

/// Add a block to the passage that has begun.
void Witnesses::pass(const Block& block) {
  if (size_ == 0) {
    return;
  }
  std::transform(noise_.begin(), noise_.end(), block.own_noise.begin(), noise_.begin(), std::plus<>());
  std::transform(cooled_.begin(), cooled_.end(), block.cooled.begin(), cooled_.begin(),
                 [](double left, double cooled) { return left + std::log(std::max(1.0 - cooled, kLeastLeft)); });
  for (std::size_t index = 0; index < size_; ++index) {
    witnesses_[index].age += block.span;
  }
  const double share = block.span / (begun_.span + block.span);
  begun_.leak += share * (block.leak - begun_.leak);
  begun_.warming += share * (block.warming - begun_.warming);
  begun_.span += block.span;
  begun_.rate_noise += block.rate_noise;
  begun_.leak_noise += block.leak_noise;
  if (std::isnan(block.reading) || begun_.span < kPassage) {
    return;
  }
  begun_.reading = block.reading;
  begun_.reading_variance = block.reading_variance;
  begun_.interval = block.interval;
  begun_.unlikely = block.unlikely;
  begun_.leaked_time = block.leaked_time;
  passages_.push_back(begun_);
  begun_ = Passage();
}

/// The first witness that has not followed all passages; none: a null pointer.
Witness* Witnesses::behind() {
  for (std::size_t index = 0; index < size_; ++index) {
    if (witnesses_[index].next < passages_.size()) {
      return &witnesses_[index];
    }
  }
  return nullptr;
}

const Witness* Witnesses::best(double film, double per_kelvin) const {
  const Witness* best = nullptr;
  for (std::size_t index = 0; index < size_; ++index) {
    const Witness& each = witnesses_[index];
    const double hidden = (film - each.filter.belief()->shared[kFilm]) * per_kelvin;
    const double least = best == nullptr ? ZeroRefutation::kEvidence : best->evidence;
    best = hidden > 0.0 && each.evidence > least ? &each : best;
  }
  return best;
}

void Witnesses::call(const Belief& belief) {
  if (size_ > 0 && (witnesses_[size_ - 1].age < kSpacing || begun_.span > 0.0)) {
    return;
  }
  if (size_ == kCount) {
    const std::size_t gone = witnesses_[1].first;
    passages_.erase(passages_.begin(), passages_.begin() + static_cast<std::ptrdiff_t>(gone));
    std::rotate(witnesses_.begin(), witnesses_.begin() + 1, witnesses_.end());
    --size_;
    for (std::size_t index = 0; index < size_; ++index) {
      witnesses_[index].first -= gone;
      witnesses_[index].next -= gone;
    }
  }
  Witness& one = witnesses_[size_++];
  one.before = belief;
  one.filter.belief()->shared = belief.shared;
  one.filter.belief()->set_covariance(belief.covariance());
  one.age = one.evidence = 0.0;
  one.first = one.next = passages_.size();
  one.noise = noise_;
  one.cooled = cooled_;
}

void Witnesses::replay(const Witness& witness, ForceErrorFilter& filter, Propagation& propagation) {
  const bool begun = begun_.span > 0.0;
  const auto count = static_cast<double>(passages_.size() - witness.first + (begun ? 1 : 0));
  for (std::size_t index = 0; index < noise_.size(); ++index) {
    passed_.own_noise[index] = (noise_[index] - witness.noise[index]) / count;
  }
  for (std::size_t taxel = 0; taxel < cooled_.size(); ++taxel) {
    passed_.cooled[taxel] = -std::expm1((cooled_[taxel] - witness.cooled[taxel]) / count);
  }
  *filter.belief() = witness.before;
  for (std::size_t index = witness.first; index < passages_.size() + (begun ? 1 : 0); ++index) {
    static_cast<Passage&>(passed_) = index < passages_.size() ? passages_[index] : begun_;
    propagation.predict(filter, passed_);
    propagation.measure_temperature(filter, passed_, false);
  }
}

}  // namespace posfet
