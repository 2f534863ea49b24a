// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/steady_window.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

SteadyWindow::SteadyWindow(Vector<double> times, std::size_t taxels)
    : time(std::move(times)),
      weights(time),
      force(time.size(), 0.0),
      charge(time.size(), 0.0),
      force_rate(taxels, 0.0),
      charge_rate(taxels, 0.0),
      response(kSharedStates, Vector<double>(time.size(), 0.0)) {
  subtract_mean(weights);
  const double square = dot(weights.data(), weights.data(), weights.size());
  for (double& each : weights) {
    each /= square;
  }
}

void SteadyWindow::add(std::size_t block, std::size_t taxel, double its_force, double its_charge) {
  force[block] += its_force;
  charge[block] += its_charge;
  force_rate[taxel] += weights[block] * its_force;
  charge_rate[taxel] += weights[block] * its_charge;
}

void subtract_mean(Vector<double>& values) {
  const double mean = sum(values) / static_cast<double>(values.size());
  for (double& each : values) {
    each -= mean;
  }
}

Taxels held_taxels(const LastBlocks& blocks, const TaxelFlags& counts) {
  Taxels held;
  for (std::size_t taxel = 0; taxel < counts.size(); ++taxel) {
    bool steady = counts[taxel];
    for (std::size_t index = 0; steady && index < blocks.size(); ++index) {
      steady = blocks[index].listed[taxel];
    }
    if (steady) {
      held.push_back(static_cast<Taxel>(taxel));
    }
  }
  return held;
}

SteadyWindow window_of(const LastBlocks& blocks, const Belief& belief, const Taxels& held) {
  SteadyWindow window(blocks.times(), held.size());
  for (std::size_t index = 0; index < blocks.size(); ++index) {
    const Block& block = blocks[index];
    for (std::size_t place = 0; place < held.size(); ++place) {
      const auto taxel = static_cast<std::size_t>(held[place]);
      std::array<double, kSharedStates> response{};
      std::copy_n(block.response.data() + taxel * kSharedStates, response.size(), response.begin());
      response[kLeak] = -block.charge[taxel];  // as it is, whatever its time constant
      const double expected =
          belief.error_of(taxel)[kForceError] + dot(response.data(), belief.shared.data(), response.size());
      window.add(index, place, block.mean[taxel] - expected, block.charge[taxel]);
      response[kFilm] = 0.0;  // the only one of these states that is not constant
      for (std::size_t shared = 0; shared < kSharedStates; ++shared) {
        window.response[shared][index] += response[shared];
      }
    }
  }
  return window;
}

}  // namespace posfet
