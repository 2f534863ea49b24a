// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// What holds until the end of the next block: correction, covariance and validity.

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// Force above which a taxel is not valid [greatest force]: one of a small gain shows more than the nominal one.
constexpr double kBeyondRange = 1.25;

}  // namespace

/// Whether the film may be so warm that it hides a force.
bool ForceEstimator::film_hides(const Belief& b) const {
  return hot_film_.may_be_hot(b) && touched_forces_.hidden_share(b) > 1.0;
}

/// Follow what zeros absorb. What presses so slowly that they have absorbed it, where warmth hides it, has let the
/// reading fall: the errors of that taxel are the usual ones.
void ForceEstimator::follow_absorbed(const Block& block, double film_rate) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (listed_[taxel] || !offset_known()[taxel]) {
      absorbed_.touch(taxel);
    }
  }
  absorbed_.follow(block, *belief(), film_rate, beside_);
  absorbed_.find(*belief(), touched_, ignored());
  // While something is released, it may look hot from one block to the next.
  const bool hides = blocks_.full() && film_hides(blocks_[0].before) && film_hides(*belief());
  if (touched_forces_.hidden_share(*belief()) <= 1.0) {
    hidden_touch_.forget();
  }
  hidden_touch_.follow_touch(touched_, mean_, touched_forces_.thermal_contact(), hides, block.duration);
  bool recalls = false;
  for (std::size_t taxel = 0; hides && taxel < taxels(); ++taxel) {
    const bool untouched = !touched_[taxel] && !ignored()[taxel] && offset_known()[taxel];
    if (untouched && absorbed_.fallen()[taxel] > HiddenTouch::kReads * array_.threshold) {
      hidden_touch_.press(taxel);
      absorbed_.recall(taxel, *belief());
      recalls = true;
    }
  }
  if (recalls) {
    forget_blocks();  // to process them again would undo it
  }
}

/// Set the correction of the next scans, covariance and validity.
void ForceEstimator::finish(const Block& block) {
  const Belief& b = *belief();
  const double rate = propagation_.film_rate(b);
  follow_absorbed(block, rate);
  Vector<double> predicted(taxels());
  filter_.predicted(block.response.data(), predicted.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double leaking = offset(taxel) / integration_->time_constant(taxel);
    const double response = array_.newton_per_kelvin[taxel] * (1.0 + b.error_of(taxel)[kPyroelectric]);
    state_.rate[taxel] = leaking + response * rate;
    state_.correction[taxel] = predicted[taxel] + touch_.loops()[taxel] + 0.5 * block.duration * state_.rate[taxel];
    state_.force[taxel] = state_.raw[taxel] - state_.correction[taxel];
    state_.held[taxel] = touched_[taxel] && counts(taxel) ? std::max(state_.force[taxel], 0.0) : 0.0;
    state_.lost[taxel] = touched_[taxel] ? state_.lost[taxel] : 0.0;
    mean_[taxel] = block.mean[taxel] - predicted[taxel];
  }
  covariance_.update(block,
                     {filter_, touch_, mean_, absorbed_.values(), touched_, beside_, listed_.any(), unconfirmed_});
  find_hot_touch();
  recovering_ = std::max(0.0, recovering_ - block.duration);
  TaxelFlags runaway(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    runaway[taxel] = !(std::abs(state_.force[taxel]) <= kRunaway * array_.greatest_force);  // NaN, too
    restarts_ += runaway[taxel] && !ignored()[taxel] ? 1 : 0;
  }
  restart(runaway);
  confirm_offsets(block.duration);
  integration_->block().valid = is_valid(block.duration);
  prepare_compensation(block);
  start_block();
}

/// Find whether what touches is so hot that force and warmth are hardly separable: no object pulls, yet the force of
/// all contacts is below zero by more than less warmth explains.
void ForceEstimator::find_hot_touch() {
  TaxelFlags counted(taxels());
  TaxelFlags below(taxels());
  double explained = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    counted[taxel] = listed_[taxel] && counts(taxel);
    below[taxel] = counted[taxel] && mean_[taxel] < -array_.threshold;
    explained += below[taxel] ? HotFilm::kGreatestWarmth * std::abs(array_.newton_per_kelvin[taxel]) : 0.0;
  }
  if (below.any() && sum_where(counted, mean_) + explained < -kGate * covariance_.total_deviation(counted)) {
    hot_film_.explains(below, mean_, touch_.warm(), beside_);
  }
}

/// Whether the forces are valid at the end of a block.
bool ForceEstimator::is_valid(double duration) {
  bool sound = true;
  bool touches = false;
  double warmed = 0.0;
  TaxelFlags counted(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    warmed += std::abs(array_.newton_per_kelvin[taxel] * belief()->shared[kWarmth] * touch_.warm()[taxel]);
    const bool fit = offset_known()[taxel] && unexplained_.below()[taxel] == 0.0 && !lower_bound_.mask()[taxel] &&
                     force()[taxel] <= kBeyondRange * array_.greatest_force;
    sound = sound && (fit || ignored()[taxel]);
    counted[taxel] = counts(taxel);
    touches = touches || (touched_[taxel] && counted[taxel]);
  }
  const double total = sum_where(counted, force());
  certainty_.add(total);
  const bool unconfirmed = std::abs(unconfirmed_) > integration_->limits().negligible;
  const bool may_touch =
      touches || unconfirmed || warmed > array_.threshold || refutation_.wide() || hidden_touch_.may_touch();
  bool certain = true;
  if (may_touch) {
    const double deviation = covariance_.total_deviation(counted);
    const double noise = std::sqrt(sum_where(counted, noise_variance_));
    refutation_.end_block(duration, total, deviation);
    certain = !hidden_touch_.may_touch() && !hot_film_.may_be_hot(*belief()) &&
              certainty_.is_certain(deviation, noise, max_relative_uncertainty);
  }
  const bool unknown_zero = touch_at_start && !zero_known_;
  return sound && certain && !unknown_zero && recovering_ <= 0.0;
}

/// Mark offsets as known once the array has been still.
void ForceEstimator::confirm_offsets(double duration) {
  if (state_.knows_offsets()) {
    return;
  }
  Vector<double> signals(taxels());
  TaxelFlags unknown(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    signals[taxel] = integration_->signal(taxel);
    unknown[taxel] = !offset_known()[taxel] && !ignored()[taxel];
  }
  // What all taxels have in common may be the film's temperature: judged by `UniformChange`, and no motion.
  const bool warms = square(belief()->shared[kRate]) > square(kSurprising) * belief()->variance(kRate);
  const bool at_rest = rest_.update(signals.data(), ignored().data(), duration, uniform_.observable() || warms);
  if (rest_.moved()) {
    restart(unknown);
  } else if (at_rest && blocks_.size() >= kStillBlocks) {
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      const double certain = square(0.5 * array_.threshold * array_.time_constant[taxel]);
      const bool known = belief()->own_of(taxel)[own_at(kOffset, kOffset)] <= certain && !ignored()[taxel];
      state_.offset_known[taxel] = state_.offset_known[taxel] || known;
    }
  }
}

/// Choose the untouched taxels that show the film's temperature scan by scan during a touch. Their small forces stay as
/// they are until the next block. The share of a uniform change that is the film's is the gain of the Kalman filter of
/// a random walk, in its limits of much and of little noise.
void ForceEstimator::prepare_compensation(const Block& block) {
  Taxels untouched;
  Vector<double> small;
  double noise = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (!touched_[taxel] && !ignored()[taxel] && offset_known()[taxel]) {
      small.push_back(mean_[taxel]);
      untouched.push_back(static_cast<Taxel>(taxel));
      noise += noise_variance_[taxel];
    }
  }
  // Fewer than half of the taxels are all at the edge of what touches, and change with it.
  const std::size_t enough = std::max(kFewestForUniform, taxels() / 2);
  if (!touched_.any() || !uniform_.observable() || untouched.size() < enough) {
    integration_->watch_none();
    return;
  }
  const auto count = static_cast<double>(untouched.size());
  const double deviation = std::sqrt(noise / count / count);
  const double walk =
      std::abs(array_.per_kelvin) * std::sqrt(belief()->variance(kRate)) * block.duration / integration_->block().scans;
  integration_->watch(untouched, small.data(), walk / (walk + deviation));
}

}  // namespace posfet
