// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/earlier_warming.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

std::optional<FoundRate> EarlierWarming::add(double time, double reading) {
  ++count_;
  const double later = time - time_;
  const double above = reading - reading_;
  time_ += later / count_;
  reading_ += above / count_;
  spread_ += later * (time - time_);
  slope_ += later * (reading - reading_);
  squares_ += above * (reading - reading_);
  if (count_ < kFewest) {
    return std::nullopt;
  }
  const double rate = slope_ / spread_;
  const double left = std::max(squares_ - rate * slope_, 0.0) / (count_ - 2);
  const double deviation = std::sqrt(std::max(left, square(kLeastReading)) / spread_);
  if (std::abs(rate) < kSurprising * deviation) {
    return std::nullopt;
  }
  return FoundRate{rate, deviation};
}

}  // namespace posfet
