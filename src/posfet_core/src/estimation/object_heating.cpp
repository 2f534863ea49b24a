// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/object_heating.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"

namespace posfet {

double ObjectHeating::update(double before, double force, double rate, double deviation, double earlier) {
  if (before <= 0.0) {
    usual_ = earlier;  // that of the last block may be misled by the touch that begins
    greatest_ = 0.0;
  }
  greatest_ = std::max(greatest_, force);
  if (force >= before) {
    return 0.0;
  }
  return std::max(std::abs(rate - usual_) - kGate * deviation, 0.0) / greatest_;
}

}  // namespace posfet
