// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/rest_detector.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "posfet_core/medians.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

RestDetector::RestDetector(std::size_t taxels, double noise, double offset_spread, double time_constant)
    : still_(kStill * noise),
      offset_spread_(offset_spread),
      leak_time_(kLeaked * time_constant),
      signal_(taxels, std::numeric_limits<double>::infinity()) {}

void RestDetector::start(const double* signal) {
  std::copy(signal, signal + signal_.size(), signal_.begin());
  duration_ = 0.0;
}

bool RestDetector::update(const double* signal, const bool* ignored, double duration, bool warming) {
  moved_ = has_moved(signal, ignored, warming);
  if (moved_) {
    start(signal);
    return false;
  }
  duration_ += duration;
  if (duration_ >= leak_time_) {
    return true;
  }
  Vector<double> signals;
  for (std::size_t taxel = 0; taxel < signal_.size(); ++taxel) {
    if (!ignored[taxel]) {
      signals.push_back(signal[taxel]);
    }
  }
  const double middle = upper_median(signals);
  return std::all_of(signals.begin(), signals.end(),
                     [this, middle](double each) { return std::abs(each - middle) <= offset_spread_; });
}

bool RestDetector::has_moved(const double* signal, const bool* ignored, bool warming) {
  double common = 0.0;
  if (warming) {
    Vector<double> changes;
    for (std::size_t taxel = 0; taxel < signal_.size(); ++taxel) {
      if (!ignored[taxel]) {
        changes.push_back(signal[taxel] - signal_[taxel]);
      }
    }
    common = upper_median(changes);
  }
  std::size_t moving = 0;
  bool far = false;
  for (std::size_t taxel = 0; taxel < signal_.size(); ++taxel) {
    const double change = ignored[taxel] ? 0.0 : std::abs(signal[taxel] - signal_[taxel] - common);
    moving += change > still_ ? 1 : 0;
    far = far || change > kSingleTaxelFactor * still_;
  }
  return far || moving >= std::min<std::size_t>(2, signal_.size());
}

}  // namespace posfet
