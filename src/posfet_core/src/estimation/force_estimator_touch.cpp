// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Where something touches, and where it has ended.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

/// Find the taxels whose force is not known to be none or small: those in contact, those that a touch may have begun
/// on, and those that were touched and have not been still since.
void ForceEstimator::find_touched(Block& block) {
  // Those touched since before an interruption have a force that is unknown: not none, whatever the signal says. Until
  // a contact is listed, a wide object presses more taxels than those whose residual is beyond its noise.
  const bool begins = !block.listed.any();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    odd_[taxel] = lower_bound_.mask()[taxel] || (begins && unexplained_.rising()[taxel]);
  }
  surroundings_.dilate(odd_, chosen_);
  const bool hot = may_be_hot();
  if (hot) {
    hot_film_.find_warm(touch_.warm(), beside_, surroundings_);
  }
  const double pressed = pressed_force();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double mean = mean_[taxel];
    const double noise = std::sqrt(noise_variance_[taxel] / integration_->block().scans);
    // Below zero no object touches, unless it is hot.
    const bool below = hot && mean < -array_.threshold && hot_film_.warm()[taxel];
    const bool left = release_.has_left(taxel, hot ? std::abs(mean) : mean, noise) && mean <= pressed;
    const bool moving = touched_[taxel] && !left;
    const bool unknown = unexplained_.rising()[taxel] || chosen_[taxel] || moving || below || refutation_.wide();
    block.touched[taxel] = block.listed[taxel] || (unknown && offset_known()[taxel]);
    odd_[taxel] = below;
  }
  hot_film_.hold(odd_);
}

/// Whether a touch leaves too few taxels to show the film's temperature.
bool ForceEstimator::is_whole(const TaxelFlags& touched) const {
  std::size_t untouched = 0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    untouched += !ignored()[taxel] && !touched[taxel] ? 1 : 0;
  }
  return untouched < kFewestForUniform;
}

/// Something wide presses all taxels.
void ForceEstimator::touch_all(Block& block) const {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.touched[taxel] = block.touched[taxel] || (offset_known()[taxel] && !ignored()[taxel]);
  }
}

/// Force of a touched taxel from which on it has not left, however still it is [N]: what presses all taxels slowly is
/// still. Infinite where nothing does.
double ForceEstimator::pressed_force() const {
  if (!refutation_.significant() || !is_whole(touched_) || usable() == 0) {
    return std::numeric_limits<double>::infinity();
  }
  double total = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    total += ignored()[taxel] ? 0.0 : mean_[taxel];
  }
  return ZeroRefutation::kPressed * total / static_cast<double>(usable());
}

/// Add to the listed taxels those of a contact that became uncertain, and was not released; those that are not beside a
/// listed contact are `lost`. Returns whether there are any. That a contact is no longer significant is no evidence of
/// zero forces. Of one with the whole array, where no untouched taxel shows the film's temperature, single taxels
/// become uncertain before the others.
bool ForceEstimator::find_unreleased(TaxelFlags& listed, Taxels& lost) {
  if (!touched_.any()) {
    return false;
  }
  const bool whole = is_whole(touched_);
  surroundings_.dilate(listed, chosen_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool was = whole ? touched_[taxel] : listed_[taxel] && !chosen_[taxel];
    if (mean_[taxel] > array_.threshold && was && !listed[taxel] && !ignored()[taxel] && offset_known()[taxel]) {
      listed[taxel] = true;
      if (!chosen_[taxel]) {  // else it is part of that contact, and is released with it
        lost.push_back(static_cast<Taxel>(taxel));
      }
    }
  }
  return !lost.empty();
}

/// Find the taxels below zero, `zeros_`, where one of them has been so for long enough: what touched since before the
/// start was released.
void ForceEstimator::find_released() {
  bool released = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros_[taxel] = odd_[taxel] && residual_[taxel] < -array_.threshold;
    released = released || (chosen_[taxel] && zeros_[taxel]);
  }
  if (!released) {
    zeros_.fill(false);
  }
}

/// Find whether the film is hotter than was known: it is where a touch may have warmed it and forces stay below zero.
/// Only what has touched since before the start and is released does that, too. Such taxels are left as they are, until
/// the film has cooled: none are in `zeros_` then.
void ForceEstimator::find_hot_film() {
  if (!zeros_.any()) {
    return;
  }
  hot_film_.find_warm(touch_.warm(), beside_, surroundings_);
  if (!hot_film_.explains(zeros_, residual_, array_.newton_per_kelvin)) {
    return;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = chosen_[taxel] && !zeros_[taxel];
    zeros_[taxel] = false;
  }
}

/// Set the forces of these taxels to zero. They and those beside them cool from then on, and what has left no longer
/// warms the chip.
void ForceEstimator::reset_released(const Block& block) {
  surroundings_.dilate(zeros_, chosen_);
  const double recovery = recovery_left();
  double left = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    left_force_[taxel] *= recovery;
    if (chosen_[taxel]) {
      absorbed_.touch(taxel);
      left_force_[taxel] = std::max(left_force_[taxel], -residual_[taxel]);
      add_own_warmth(belief()->own_of(taxel), square(priors_.warmth_mean * array_.newton_per_kelvin[taxel]));
    }
    if (zeros_[taxel]) {
      left -= residual_[taxel];
      belief()->reset_force_error(taxel, block.mean[taxel], block.response.data() + taxel * kSharedStates,
                                  block.noise[taxel]);
    }
  }
  filter_.admit(direction_of(kRate).data(), square(priors_.touch_rate * left));
  zero_known_ = true;
  rested_ = unseen_for_ = 0.0;
  refutation_.clear();
  forget_blocks();  // to process them again would undo it
}

/// Set the forces of released contacts to zero. Those of which only is known that their film cools tell nothing of what
/// taxels share: how warm each taxel has become may be wrong.
void ForceEstimator::release(Block& block, const Vector<const Taxels*>& contacts) {
  std::vector<double>& variance = values_;
  std::vector<double>& course = residual_;
  filter_.predicted(block.response.data(), course.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    variance[taxel] = whole_variance(taxel);
    const double* response = block.response.data() + taxel * kSharedStates;
    course[taxel] = block.mean[taxel] - course[taxel] + dot(response + kBend, belief()->shared.data() + kBend, kBends);
  }
  std::vector<double>& rise = deviation_;
  const bool known = blocks_.size() > ReleaseDetector::kStillBlocks;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    rise[taxel] =
        known ? block.mean[taxel] - blocks_[blocks_.size() - 1 - ReleaseDetector::kStillBlocks].mean[taxel] : 0.0;
  }
  const bool released = release_.update(contacts, mean_.data(), course.data(), rise.data(), touched_.data(),
                                        variance.data(), block.noise.data(), block.duration, chosen_.data());
  if ((!find_left(contacts) && !released) || !drop_shown(variance)) {
    return;
  }
  find_absorbed();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (chosen_[taxel]) {
      touch_.reduce_warmth(taxel, mean_[taxel], belief()->shared[kWarmth]);
      belief()->own_of(taxel)[own_at(kForceError, kForceError)] += square(absorbed_.values()[taxel]);
    }
    noise_[taxel] = block.noise[taxel] + kTailNoise;
  }
  touch_.matrix(block.response);
  filter_.innovation(block.mean.data(), block.response.data(), noise_.data(), residual_.data(), sensitivity_.data(),
                     deviation_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    left_[taxel] = left_[taxel] && chosen_[taxel];
    chosen_[taxel] = chosen_[taxel] && !left_[taxel];
  }
  filter_.update_alone(left_.data(), residual_.data(), sensitivity_.data(), noise_.data());
  filter_.update(chosen_.data(), residual_.data(), sensitivity_.data(), noise_.data());
}

/// Add to the released taxels in `chosen_` those of contacts whose film cools, which are in `left_`; returns whether
/// there are any.
bool ForceEstimator::find_left(const Vector<const Taxels*>& contacts) {
  const bool any = thermal_contact_.find_left(contacts, left_);
  for (std::size_t taxel = 0; taxel < taxels() && any; ++taxel) {
    left_[taxel] = left_[taxel] && !chosen_[taxel];
    chosen_[taxel] = chosen_[taxel] || left_[taxel];
  }
  return any;
}

/// Drop, of the taxels in `chosen_` that look released, those beside a noisy taxel that still shows a force beyond its
/// variance; return whether any are left.
bool ForceEstimator::drop_shown(const std::vector<double>& variance) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double least = std::max(array_.threshold, kGate * std::sqrt(variance[taxel]));
    odd_[taxel] = ignored()[taxel] && informative_[taxel] && mean_[taxel] > least;
  }
  surroundings_.dilate(odd_, zeros_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = chosen_[taxel] && !zeros_[taxel];
  }
  return chosen_.any();
}

/// End the touches since before an interruption: where forces stay below zero, they are zero.
void ForceEstimator::end_unknown_touch(const Block& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double limit = kGate * std::sqrt(2.0) * std::sqrt(block.noise[taxel]);
    chosen_[taxel] = std::abs(mean_[taxel] - last_mean_[taxel]) <= limit;
  }
  TaxelFlags ended(taxels());
  lower_bound_.update(mean_.data(), chosen_.data(), block.duration, ended.data());
  last_mean_ = mean_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (ended[taxel]) {
      belief()->reset_force_error(taxel, block.mean[taxel], block.response.data() + taxel * kSharedStates,
                                  block.noise[taxel]);
    }
  }
  if (ended.any()) {
    rested_ = 0.0;
    forget_blocks();  // to process them again would undo it
  }
}

}  // namespace posfet
