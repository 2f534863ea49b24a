// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/block_end.hpp"

#include <stdexcept>
#include <utility>

namespace posfet {

namespace {

bool fit_together(const BlockParts& parts, std::size_t taxels) {
  return parts.estimator && parts.faults && parts.bursts && parts.hum && parts.finder &&
         parts.estimator->taxels() == taxels && parts.faults->taxels() == taxels &&
         static_cast<std::size_t>(parts.bursts->taxels()) == taxels && parts.hum->taxels() == taxels &&
         static_cast<std::size_t>(parts.finder->grid().taxels()) == taxels;
}

}  // namespace

BlockEnd::BlockEnd(std::shared_ptr<ScanPath> path, BlockParts parts, Taxel margin, double informative)
    : path_(std::move(path)), parts_(std::move(parts)), margin_(margin), informative_(informative) {
  if (!path_ || !fit_together(parts_, path_->taxels())) {
    throw std::invalid_argument("all parts must be of one array");
  }
  const std::size_t taxels = path_->taxels();
  touched_ = TaxelFlags(taxels);
  flags_ = TaxelFlags(taxels);
  for (auto* values : {&mean_, &variance_, &charge_}) {
    values->resize(taxels);
  }
  parts_.estimator->ignore(parts_.faults->faulty().data());
  choose_interpolated();
  set_thresholds();
}

void BlockEnd::close() {
  const double duration = parts_.estimator->block_time();
  const Mask& touched = parts_.finder->thresholds().touched_since_update();
  for (std::size_t taxel = 0; taxel < touched.size(); ++taxel) {
    touched_[taxel] = touched[taxel] != 0;
  }
  test_taxels(dilated(parts_.finder->grid(), touched, margin_));
  const bool hummed = parts_.hum->state().present;
  close_hum();
  close_estimator();
  const bool begins = parts_.estimator->age() < kSearchPause && !touched_.any();
  if (begins && !hummed && parts_.hum->strong()) {
    parts_.estimator->forget();  // it has started with a hum, which no zero explains
  }
  choose_interpolated();
  update_thresholds(duration);
}

void BlockEnd::start() {
  if (path_->clock().interrupted()) {
    parts_.estimator->interrupt();
    parts_.hum->forget();
  }
  parts_.estimator->start(path_->charge().data());
}

void BlockEnd::set_hum(std::shared_ptr<MainsHum> hum) {
  path_->set_hum(hum);
  parts_.hum = std::move(hum);
}

/// Test the taxels by the forces and counts of the block; `near` are those in or near a contact.
void BlockEnd::test_taxels(const Mask& near) {
  ForceEstimator& estimator = *parts_.estimator;
  TaxelFaultDetector& faults = *parts_.faults;
  const bool* const saturated = path_->saturated().data();
  if (detects_faults) {
    estimator.block_mean(mean_.data());
    estimator.steady_variance(variance_.data());
    estimator.residual_charge(charge_.data());
    const TestedBlock block{estimator.block_time(), mean_.data(), variance_.data(),
                            charge_.data(),         saturated,    estimator.offset_known().data()};
    if (faults.close_block(block, near)) {
      estimator.ignore(faults.faulty().data());
    }
  } else {
    faults.measure_noise(estimator.block_time(), saturated, near);
  }
  estimator.set_noise_variance(faults.noise_variance().data());
  parts_.bursts->set_usual_change(faults.usual_change().data());
}

void BlockEnd::close_hum() {
  const TaxelFlags& saturated = path_->saturated();
  const TaxelFlags& faulty = parts_.faults->faulty();
  for (std::size_t taxel = 0; taxel < flags_.size(); ++taxel) {
    flags_[taxel] = faulty[taxel] || saturated[taxel];
  }
  parts_.hum->close_block(touched_.data(), flags_.data(), parts_.estimator->block_time());
}

void BlockEnd::close_estimator() {
  contacts_.clear();
  for (const Contact& contact : path_->contacts()) {
    if (path_->shows_released() || contact.state != ContactState::kReleased) {
      contacts_.push_back(&contact.region.taxels);
    }
  }
  parts_.estimator->close_block(touched_.data(), contacts_);
}

/// Choose the faulty taxels that are interpolated: not noisy ones that are still informative.
void BlockEnd::choose_interpolated() {
  TaxelFaultDetector& faults = *parts_.faults;
  if (!faults.any_faulty()) {
    path_->set_faulty(nullptr, nullptr);
    return;
  }
  TaxelFlags& informative = parts_.estimator->informative();
  faults.find_informative(informative_, informative.data());
  for (std::size_t taxel = 0; taxel < flags_.size(); ++taxel) {
    informative[taxel] = informative[taxel] && parts_.estimator->offset_known()[taxel];
    flags_[taxel] = faults.faulty()[taxel] && !informative[taxel];
  }
  path_->set_faulty(faults.faulty().data(), flags_.data());
}

void BlockEnd::set_thresholds() { update_thresholds(0.0); }

/// Set the thresholds, after `duration` since they were set [s].
void BlockEnd::update_thresholds(double duration) {
  const ForceEstimator& estimator = *parts_.estimator;
  estimator.force_variance(variance_.data());
  path_->set_variance(variance_.data());
  estimator.variance(variance_.data());
  const TaxelFlags& interpolated = path_->interpolated();
  for (std::size_t taxel = 0; taxel < flags_.size(); ++taxel) {
    flags_[taxel] = estimator.offset_known()[taxel] || interpolated[taxel];
    variance_[taxel] = interpolated[taxel] ? 0.0 : variance_[taxel];  // their forces are interpolated
  }
  const bool all = estimator.valid() && !parts_.faults->any_faulty();
  parts_.finder->thresholds().update(estimator.force().data(), variance_.data(), all ? nullptr : flags_.data(),
                                     duration);
}

}  // namespace posfet
