// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// When what all taxels show is a change of the film's temperature.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "posfet_core/numbers.hpp"

namespace posfet {

/// Hypothesis that all taxels changed because the film's temperature did, faster than the filter expects.
///
/// A press on the whole array looks the same at first. What distinguishes it is its pattern, as warming acts on every
/// taxel by its pyroelectric response; its rate; and, after `kConfirmation`, what the sensors show.
class UniformChange {
public:
  /// Share of the taxels that may not fit the pattern [1].
  static constexpr double kMisfits = 0.2;

  /// Time after which the chip's sensors must show the change, and twice their lag [s]: three readings.
  static constexpr double kConfirmation = 0.3;

  /// A new reading is awaited for this long [s].
  static constexpr double kInterval = 0.15;

  /// Share of it that they must show [1].
  static constexpr double kConfirmed = 0.3;

  /// Least change that the sensors resolve, in deviations of what they show [1]; a smaller one is no contact.
  static constexpr double kDistinct = 4.0;

  /// Time with known forces for which a refused hypothesis is not made again [s]: where the whole array was pressed, it
  /// soon is again.
  static constexpr double kPause = 1.0;

  /// Pyroelectric signal of each taxel [N/K], which stays where it is, and the relative standard deviation of these
  /// [1].
  UniformChange(const std::vector<double>& newton_per_kelvin, double spread);

  std::size_t taxels() const { return per_kelvin_.size(); }

  /// Whether the pattern is informative.
  bool observable() const { return observable_; }

  /// Whether the hypothesis is open for a rise of the forces.
  bool open() const { return !std::isnan(open_); }

  /// Whether the hypothesis may be made now.
  bool may_open() const { return pause_ <= 0.0; }

  /// The temperature change that explains the residuals [N] of a block of `duration` [s], of the taxels with a known
  /// force [K]; 0: there is none. `deviation` are their expected deviations [N], `own` those of what the taxels do not
  /// share [N], which averages out; `noticed`: one of the residuals alone is not expected.
  double temperature(const double* residual, const bool* where, const double* deviation, const double* own,
                     double duration, bool noticed);

  /// Open the hypothesis that the forces rise with the film's temperature.
  void begin() { open_ = 0.0; }

  /// What the sensors say of the hypothesis.
  struct Evidence {
    double claimed;     ///< Change of the film's temperature according to the hypothesis [K].
    double shown;       ///< The change of the film according to the sensors [K].
    double deviation;   ///< Standard deviation of that change [K].
    double negligible;  ///< Difference of both that makes no difference to the forces [K].
    double wait;        ///< Time after which the sensors show most of a change of the film [s].
  };

  /// Process a block of `duration` [s]; return whether the open hypothesis is wrong, as the share of the `judged`
  /// taxels that do not fit the pattern, `odd`, or the sensors say. It stays open while what it claims matters, and the
  /// sensors cannot decide.
  bool is_refused(std::size_t odd, std::size_t judged, const Evidence& evidence, double duration);

  /// Close the hypothesis as wrong.
  void refuse();

  /// Close the hypothesis, wrong or not.
  void close() { open_ = kUnknown; }

private:
  const std::vector<double>& per_kelvin_;
  double spread_;
  bool observable_;
  double pause_ = 0.0;      ///< Time for which the hypothesis must not be made [s].
  double open_ = kUnknown;  ///< Time for which it has been open [s]; NaN: it is not.
};

}  // namespace posfet
