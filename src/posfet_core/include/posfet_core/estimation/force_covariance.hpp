// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the reported covariance of the forces consists of.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/contact_surroundings.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/estimation/hidden_force.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/force_integration.hpp"

namespace posfet {

/// Covariance of the forces at the end of a block: a variance of each taxel's own, and a factor of what they share, for
/// which the integration has the place. Beside what the filter knows it has causes that are no states: the filter would
/// explain by them what is no error.
class ForceCovariance {
public:
  /// What is known at the end of a block; arrays have one value for each taxel.
  struct Known {
    const ForceErrorFilter& filter;       ///< After the block.
    const TouchResponse& touch;           ///< After the block.
    const std::vector<double>& mean;      ///< Mean force [N].
    const std::vector<double>& absorbed;  ///< What zeros may have taken of it [N].
    const TaxelFlags& touched;            ///< Touched taxels,
    const TaxelFlags& beside;             ///< and their neighbours.
    bool listed;                          ///< Whether a contact is listed.
    double unconfirmed;                   ///< Temperature of the film that the sensors do not show [K].
  };

  ForceCovariance(const EstimatedArray& array, const ContactSurroundings& surroundings,
                  ForceIntegration::State& integrated);

  /// Find the covariance at the end of a block, with the touched forces that the integration holds then.
  void update(const Block& block, const Known& known);

  /// Variance of each force that it does not share with others [N2].
  const std::vector<double>& own() const { return own_; }

  /// Variance that each force would have without a touch [N2].
  const std::vector<double>& untouched() const { return untouched_; }

  /// Variance of a force, but for what one object differs from others by [N2]: no evidence of a motion or a release
  /// depends on that.
  double of_motion(std::size_t taxel) const;

  /// Standard deviation of the total force of some taxels [N].
  double total_deviation(const TaxelFlags& counted) const;

private:
  void add_causes(std::size_t taxel, const Known& known, double object) const;

  const EstimatedArray& array_;
  ForceIntegration::State& integrated_;
  HiddenForce hidden_;
  std::vector<double> own_;
  std::vector<double> untouched_;
};

}  // namespace posfet
