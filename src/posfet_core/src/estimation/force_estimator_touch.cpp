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

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// Whether a touch leaves too few taxels to show the film's temperature.
bool is_whole(const TaxelFlags& touched, const TaxelFlags& ignored) {
  std::size_t untouched = 0;
  for (std::size_t taxel = 0; taxel < touched.size(); ++taxel) {
    untouched += !ignored[taxel] && !touched[taxel] ? 1 : 0;
  }
  return untouched < kFewestForUniform;
}

}  // namespace

/// Find the taxels whose force is not known to be none or small: those in contact, those that a touch may have begun
/// on, and those that were touched and have not been still since.
void ForceEstimator::find_touched(Block& block) {
  // Those touched since before an interruption have a force that is unknown: not none, whatever the signal says. Until
  // a contact is listed, a wide object presses more taxels than those whose residual is beyond its noise.
  const bool begins = !block.listed.any();
  TaxelFlags usable(taxels());
  TaxelFlags unknown(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    usable[taxel] = !ignored()[taxel];
    unknown[taxel] = lower_bound_.mask()[taxel] || (begins && unexplained_.rising()[taxel]);
  }
  TaxelFlags near_unknown(taxels());
  surroundings_.dilate(unknown, near_unknown);
  const bool hot = hot_film_.may_be_hot(*belief());
  const TaxelFlags& warm = hot_film_.find_warm(touch_.warm(), beside_);
  const double pressed = is_whole(touched_, ignored())
                             ? refutation_.pressed_force(sum_where(usable, mean_), state_.usable())
                             : std::numeric_limits<double>::infinity();
  TaxelFlags below(taxels());
  hidden_touch_.follow_readings(mean_, film_hides(*belief()));
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double mean = mean_[taxel];
    const double noise = std::sqrt(noise_variance_[taxel] / integration_->block().scans);
    // Below zero no object touches, unless it is hot.
    below[taxel] = hot && mean < -array_.threshold && warm[taxel];
    const bool left = release_.has_left(taxel, hot ? std::abs(mean) : mean, noise) && mean <= pressed;
    const bool moving = touched_[taxel] && !left;
    const bool may_touch = unexplained_.rising()[taxel] || near_unknown[taxel] || moving || below[taxel] ||
                           hidden_touch_.presses(taxel) || refutation_.wide();
    block.touched[taxel] = block.listed[taxel] || (may_touch && offset_known()[taxel]);
  }
  hot_film_.hold(below);
}

/// Add to the listed taxels those of a contact that became uncertain, and was not released; returns those of them that
/// are not beside a listed contact. That a contact is no longer significant is no evidence of zero forces. Of one with
/// the whole array, where no untouched taxel shows the film's temperature, single taxels become uncertain before the
/// others.
Taxels ForceEstimator::find_unreleased(TaxelFlags& listed) const {
  Taxels lost;
  if (!touched_.any()) {
    return lost;
  }
  const bool whole = is_whole(touched_, ignored());
  TaxelFlags near(taxels());
  surroundings_.dilate(listed, near);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool was = whole ? touched_[taxel] : listed_[taxel] && !near[taxel];
    if (mean_[taxel] > array_.threshold && was && !listed[taxel] && !ignored()[taxel] && offset_known()[taxel]) {
      listed[taxel] = true;
      if (!near[taxel]) {  // else it is part of that contact, and is released with it
        lost.push_back(static_cast<Taxel>(taxel));
      }
    }
  }
  return lost;
}

/// Find the taxels below zero, among those with an unexplained residual, where one has been so for long enough to be
/// one of the `errors`: what touched since before the start was released. Or the film is hotter than was known: it is
/// where a touch may have warmed it and forces stay below zero. Such taxels are left as they are, until the film has
/// cooled: none are found then, nor are they errors.
TaxelFlags ForceEstimator::find_released(const TaxelFlags& odd, TaxelFlags& errors) {
  TaxelFlags below(taxels());
  bool lasts = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    below[taxel] = odd[taxel] && residuals_[taxel] < -array_.threshold;
    lasts = lasts || (errors[taxel] && below[taxel]);
  }
  const bool hot = lasts && hot_film_.explains(below, residuals_.values(), touch_.warm(), beside_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    errors[taxel] = errors[taxel] && !(hot && below[taxel]);
    below[taxel] = below[taxel] && lasts && !hot;
  }
  return below;
}

/// Set the forces of these taxels to zero. They and those beside them cool from then on, and what has left no longer
/// warms the chip.
void ForceEstimator::reset_released(const Block& block, const TaxelFlags& released) {
  TaxelFlags near(taxels());
  surroundings_.dilate(released, near);
  unseen_.begin();
  double left = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (near[taxel]) {
      absorbed_.touch(taxel);
      unseen_.leave(taxel, -residuals_[taxel]);
      add_own_warmth(belief()->own_of(taxel), square(array_.priors.warmth_mean * array_.newton_per_kelvin[taxel]));
    }
    left -= released[taxel] ? residuals_[taxel] : 0.0;
  }
  set_to_zero(block, released);
  filter_.admit(direction_of(kRate).data(), square(array_.priors.touch_rate * left));
  zero_known_ = true;
  refutation_.clear();
}

/// Set the forces of taxels to zero, whatever was believed of them.
void ForceEstimator::set_to_zero(const Block& block, const TaxelFlags& where) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (where[taxel]) {
      belief()->reset_force_error(taxel, block.mean[taxel], block.response.data() + taxel * kSharedStates,
                                  block.noise[taxel]);
    }
  }
  rested_ = 0.0;
  forget_blocks();  // to process them again would undo it
}

/// Set the forces of released contacts to zero. Those of which only is known that their film cools tell nothing of what
/// taxels share: how warm each taxel has become may be wrong.
void ForceEstimator::release(Block& block, const Vector<const Taxels*>& contacts) {
  TaxelFlags ended(taxels());
  TaxelFlags left(taxels());
  if (!find_ended(block, contacts, ended, left)) {
    return;
  }
  absorbed_.find(*belief(), touched_, ignored());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (ended[taxel] || left[taxel]) {
      touch_.reduce_warmth(taxel, mean_[taxel], belief()->shared[kWarmth]);
      belief()->own_of(taxel)[own_at(kForceError, kForceError)] += square(absorbed_.values()[taxel]);
    }
  }
  touch_.matrix(block.response.data());
  residuals_.expect_release(block);
  residuals_.compare(filter_);
  residuals_.update_alone(filter_, left);
  residuals_.update(filter_, ended);
}

/// Find the taxels of contacts that have ended, and those of others whose film cools, as they were left. Not those
/// beside a noisy taxel that still shows a force beyond its deviation. Returns whether there are any.
bool ForceEstimator::find_ended(const Block& block, const Vector<const Taxels*>& contacts, TaxelFlags& ended,
                                TaxelFlags& left) {
  Vector<double> variance(taxels());
  Vector<double> course(taxels());
  Vector<double> rise(taxels());
  TaxelFlags shown(taxels());
  filter_.forces(block.mean.data(), block.response.data(), course.data());
  const std::size_t blocks = blocks_.size();
  const bool known = blocks > kStillBlocks;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    variance[taxel] = covariance_.of_motion(taxel);
    const double* response = block.response.data() + taxel * kSharedStates;
    course[taxel] += dot(response + kBend, belief()->shared.data() + kBend, kBends);
    rise[taxel] = known ? block.mean[taxel] - blocks_[blocks - 1 - kStillBlocks].mean[taxel] : 0.0;
    const double least = std::max(array_.threshold, kGate * std::sqrt(variance[taxel]));
    shown[taxel] = ignored()[taxel] && informative_[taxel] && mean_[taxel] > least;
  }
  const bool released = release_.update(contacts, mean_.data(), course.data(), rise.data(), touched_.data(),
                                        variance.data(), block.noise.data(), block.duration, ended.data());
  if (!touched_forces_.find_left(contacts, left) && !released) {
    return false;
  }
  TaxelFlags near_shown(taxels());
  surroundings_.dilate(shown, near_shown);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    left[taxel] = left[taxel] && !ended[taxel] && !near_shown[taxel];
    ended[taxel] = ended[taxel] && !near_shown[taxel];
  }
  return ended.any() || left.any();
}

/// End the touches since before an interruption: where forces stay below zero, they are zero.
void ForceEstimator::end_unknown_touch(const Block& block) {
  TaxelFlags still(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double limit = kGate * std::sqrt(2.0) * std::sqrt(block.noise[taxel]);
    still[taxel] = std::abs(mean_[taxel] - last_mean_[taxel]) <= limit;
  }
  TaxelFlags ended(taxels());
  lower_bound_.update(mean_.data(), still.data(), block.duration, ended.data());
  last_mean_ = mean_;
  if (ended.any()) {
    set_to_zero(block, ended);
  }
}

}  // namespace posfet
