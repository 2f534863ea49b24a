// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/hum_filter.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/numbers.hpp"

namespace posfet {

HumFilter::HumFilter(std::size_t taxels, std::size_t scans)
    : taxels_(taxels), parts_(2 * kHumOrders.size() * taxels, 0.0), window_(scans * taxels, 0.0), times_(scans, 0.0) {
  state_.sampling = scans > 0;
}

void HumFilter::remove(double* signal, double step) {
  state_.time += step;
  if (state_.present) {
    const double angle = state_.phase + kTurn * state_.frequency * state_.time;
    for (std::size_t index = 0; index < kHumOrders.size(); ++index) {
      const double cosine = std::cos(kHumOrders[index] * angle);
      const double sine = std::sin(kHumOrders[index] * angle);
      const double* const of_cosine = parts_.data() + 2 * index * taxels_;
      const double* const of_sine = of_cosine + taxels_;
      for (std::size_t taxel = 0; taxel < taxels_; ++taxel) {
        signal[taxel] -= cosine * of_cosine[taxel] + sine * of_sine[taxel];
      }
    }
  }
  if (state_.filled < times_.size()) {
    std::copy(signal, signal + taxels_, window_.begin() + static_cast<std::ptrdiff_t>(state_.filled * taxels_));
    times_[state_.filled] = state_.time;
    ++state_.filled;
  }
}

void HumFilter::start_window() {
  const double phase = std::fmod(state_.phase + kTurn * state_.frequency * state_.time, kTurn);
  state_.phase = phase < 0.0 ? phase + kTurn : phase;
  state_.time = 0.0;
  state_.filled = 0;
  state_.sampling = !times_.empty();
}

void HumFilter::clear() {
  state_.present = false;
  std::fill(parts_.begin(), parts_.end(), 0.0);
}

}  // namespace posfet
