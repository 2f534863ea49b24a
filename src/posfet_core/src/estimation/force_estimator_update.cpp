// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// A step of the filter: what is known of the forces of a block, and what follows for the errors.

#include <algorithm>
#include <cmath>
#include <vector>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// Factor on the prior deviation of the residual charge after that prior was rejected [1].
constexpr double kRejected = 3.0;

}  // namespace

/// Process the stored blocks again without the taxels that a touch, it turned out, had begun on. Those that do not show
/// it themselves are left out of the last blocks only: their zeros before that tell their offsets. Where sensors have
/// refuted the zeros of all, the rate may have been wrong before these blocks, too.
void ForceEstimator::process_again(const TaxelFlags& touched) {
  ++processed_again_;
  const bool wide = refuted_ != 0.0 || propagation_.is_misled(blocks_, *belief());
  *belief() = blocks_[0].before;
  if (refuted_ != 0.0) {
    witnesses_.clear();  // of another past
    const double since = std::max(LastBlocks::kLag * kBlock, blocks_.duration());
    const std::vector<double>& direction = propagation_.maneuver(*belief(), since);
    filter_.admit(direction.data(), square(refuted_ / direction[kFilm]));
  }
  const std::size_t count = blocks_.size();  // the newest one may restart taxels, which forgets them
  TaxelFlags shown(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    shown[taxel] = touched[taxel] && (blocks_.newest().listed[taxel] || unexplained_.rising()[taxel]);
  }
  for (std::size_t index = 0; index < count; ++index) {
    const TaxelFlags& begun = index + LastBlocks::kSuspected < count ? shown : touched;
    TaxelFlags& stored = blocks_[index].touched;
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      stored[taxel] = stored[taxel] || begun[taxel] || (wide && offset_known()[taxel]);
    }
  }
  for (std::size_t index = 0; index < count; ++index) {
    blocks_[index].before = *belief();
    step(index);
  }
}

/// Propagate the belief over a stored block, and update it by the temperature and by the forces that are known.
void ForceEstimator::step(std::size_t index) {
  Block& block = blocks_[index];
  propagation_.predict(filter_, block);
  bool zeros = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double& variance = belief()->own_of(taxel)[own_at(kOffset, kOffset)];
    variance = std::max(variance, rest_noise_.jumps().least_offset_variance(taxel));
    zeros = zeros || (!block.touched[taxel] && !ignored()[taxel] && unexplained_.below()[taxel] == 0.0);
  }
  const auto found = propagation_.measure_temperature(filter_, block, zeros);
  block.unlikely = std::min(found.square, square(kSurprising)) + found.spread;
  const bool hidden = zeros && found.kelvin * array_.per_kelvin < 0.0 && !uniform_.open() && has_rested();
  refuted_ = 0.0;
  if (hidden && found.deviations > ZeroRefutation::kSignificant && propagation_.is_misled(blocks_, *belief())) {
    refuted_ = found.kelvin;
    refutation_.refute();
  }
  measure_zeros(index);
}

/// Update by the forces that are known to be zero or small.
void ForceEstimator::measure_zeros(std::size_t index) {
  const Block& block = blocks_[index];
  Zeros zeros(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool usable = !ignored()[taxel];
    zeros.judged[taxel] = usable && !(block.listed[taxel] && offset_known()[taxel]);
    zeros.faulty[taxel] = !usable && offset_known()[taxel] && !block.listed[taxel];
    zeros.known[taxel] = usable && !(block.touched[taxel] && offset_known()[taxel]) && !unseen_.recovers(taxel);
  }
  residuals_.expect_small_forces(block, *belief(), touch_);
  residuals_.compare(filter_);
  residuals_.admit_warmer_object(filter_, zeros.known, touch_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros.odd[taxel] = residuals_.is_odd(taxel);
  }
  explain_by_temperature(index, zeros);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    // Of a release, some blocks look like a film that cools.
    const bool released = unexplained_.below()[taxel] > 0.0 && residuals_[taxel] < -array_.threshold;
    zeros.odd[taxel] = zeros.odd[taxel] || released;
    zeros.known[taxel] = zeros.known[taxel] && !zeros.odd[taxel];
  }
  if (zeros.known.any()) {
    residuals_.update(filter_, zeros.known);
  }
  measure_alone(block, zeros);
  if (index + 1 < blocks_.size()) {
    return;
  }
  find_slow_touches(block, zeros);
  judge(blocks_[index], zeros);
}

/// Find taxels whose residuals have been positive for too long. What most taxels share, an update has explained: it is
/// no touch of a single one. Keeps of the residuals that are not expected those of taxels that count.
void ForceEstimator::find_slow_touches(const Block& block, Zeros& zeros) {
  TaxelFlags updated(taxels());
  TaxelFlags watched(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    updated[taxel] = !block.touched[taxel] && !zeros.odd[taxel];
    const bool counts = zeros.judged[taxel] || zeros.faulty[taxel];
    watched[taxel] = counts && !block.touched[taxel] && offset_known()[taxel];
  }
  // Responses differ, and leak as time constants do: by the rate before a touch that may have changed it.
  Vector<double> left(taxels());
  residuals_.find_left(filter_, updated, blocks_[0].before.shared[kRate], block.duration, left.data());
  unexplained_.add_persistent(watched.data(), left.data(), zeros.odd.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros.odd[taxel] = zeros.odd[taxel] && (zeros.judged[taxel] || zeros.faulty[taxel]);
  }
}

/// Update the taxels whose forces say nothing of the others: those that recover unseen, and the faulty ones. A noisy
/// taxel still counts in a contact, and so must be zero before it.
void ForceEstimator::measure_alone(const Block& block, const Zeros& zeros) {
  TaxelFlags alone(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool unseen = !ignored()[taxel] && unseen_.recovers(taxel);
    alone[taxel] = (unseen || zeros.faulty[taxel]) && !block.touched[taxel] && !zeros.odd[taxel];
  }
  if (alone.any()) {
    residuals_.update_alone(filter_, alone);
  }
}

/// Act on the residuals of the newest block that no state explains.
void ForceEstimator::judge(Block& block, Zeros& zeros) {
  UniformChange::Evidence evidence{};
  if (uniform_.open()) {
    evidence = unheated_.judge(block, belief()->shared[kFilm], integration_->limits().negligible);
  }
  std::size_t odd = 0;
  std::size_t judged = 0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    odd += zeros.odd[taxel] && zeros.judged[taxel] ? 1 : 0;
    judged += zeros.judged[taxel] ? 1 : 0;
  }
  if (uniform_.is_refused(odd, judged, evidence, block.duration)) {
    uniform_.refuse();
    take_unheated(block, zeros);
  }
  unconfirmed_ = uniform_.open() ? evidence.claimed - evidence.shown : unnoticed_change();
  restart_or_correct(block, zeros.odd);
}

/// Restart the taxels with an unexplained residual whose offset is unknown, and widen the errors of the others where it
/// is one of the baseline.
void ForceEstimator::restart_or_correct(Block& block, TaxelFlags& odd) {
  TaxelFlags unknown(taxels());
  Vector<double> deviation(taxels());  // of a mean
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    unknown[taxel] = odd[taxel] && !offset_known()[taxel];
    odd[taxel] = odd[taxel] && offset_known()[taxel];
    if (unknown[taxel]) {
      left_charge_[taxel] = std::min(kRejected * left_charge_[taxel], kRunaway * array_.greatest_force);
      ++restarts_;
    }
    deviation[taxel] = std::sqrt(block.noise[taxel]);
  }
  restart(unknown);
  TaxelFlags errors(taxels());
  unexplained_.update(odd.data(), residuals_.values().data(), block.mean.data(), deviation.data(), block.duration,
                      errors.data());
  const TaxelFlags released = find_released(odd, errors);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (errors[taxel] && !released[taxel]) {
      const std::size_t variance = own_at(kForceError, kForceError);
      belief()->own_of(taxel)[variance] += square(residuals_[taxel]);
      block.own_noise[taxel * kOwnStates * kOwnStates + variance] += square(residuals_[taxel]);  // if processed again
    }
  }
  if (released.any()) {
    reset_released(block, released);
  }
}

}  // namespace posfet
