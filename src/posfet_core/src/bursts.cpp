// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/bursts.hpp"

#include <cmath>
#include <limits>

#include "posfet_core/numbers.hpp"

namespace posfet {

BurstDetector::BurstDetector(const SkinResponse& skin, double least, double variance, double charge_per_newton)
    : skin_(skin),
      jumps_(skin.grid().taxels(), least),
      least_(least),
      scale_(charge_per_newton),
      variance_(static_cast<std::size_t>(skin.grid().taxels()), variance),
      limits_(variance_.size(), least),
      sound_(variance_.size(), true) {}

void BurstDetector::set_usual_change(const double* change) {
  for (std::size_t taxel = 0; taxel < limits_.size(); ++taxel) {
    limits_[taxel] = maximum(least_, kUsualChanges * scale_ * change[taxel]);
  }
  jumps_.set_limits(limits_.data());
}

bool BurstDetector::is_burst(const double* charge, std::uint64_t sequence, const bool* faulty) {
  const bool adjacent = started_ && sequence_ != std::numeric_limits<std::uint64_t>::max() && sequence == sequence_ + 1;
  started_ = true;
  sequence_ = sequence;
  if (!jumps_.examine(charge, adjacent, faulty)) {
    return false;
  }
  const bool found = is_no_touch(faulty);
  if (found) {
    jumps_.refuse();
  } else {
    jumps_.accept();
  }
  return found;
}

/// Whether no touch can have caused the jump of the fresh taxels.
bool BurstDetector::is_no_touch(const bool* faulty) {
  const double* const jump = jumps_.jump().data();
  for (std::size_t taxel = 0; taxel < sound_.size(); ++taxel) {
    sound_[taxel] = !faulty[taxel];
  }
  for (std::size_t taxel = 0; taxel < sound_.size(); ++taxel) {
    if (jumps_.fresh()[taxel] != 0 &&
        skin_.test(static_cast<Taxel>(taxel), jump, variance_.data(), sound_.data(), kBurstCertainty, true)
            .contradicted) {
      return true;
    }
  }
  return is_even();
}

/// Whether nearly all sound taxels jump by similar amounts, and half of them afresh.
bool BurstDetector::is_even() const {
  const std::vector<double>& jump = jumps_.jump();
  std::size_t count = 0;
  std::size_t fresh = 0;
  double greatest = 0.0;
  for (std::size_t taxel = 0; taxel < sound_.size(); ++taxel) {
    if (sound_[taxel]) {
      ++count;
      fresh += jumps_.fresh()[taxel] != 0 ? 1 : 0;
      greatest = std::fabs(jump[taxel]) > std::fabs(greatest) ? jump[taxel] : greatest;
    }
  }
  std::size_t similar = 0;
  for (std::size_t taxel = 0; taxel < sound_.size(); ++taxel) {
    similar += sound_[taxel] && jump[taxel] / greatest >= kEvenly ? 1 : 0;
  }
  return count >= kFewestOfBurst && 2 * fresh >= count &&
         static_cast<double>(similar) >= kMostOfBurst * static_cast<double>(count);
}

}  // namespace posfet
