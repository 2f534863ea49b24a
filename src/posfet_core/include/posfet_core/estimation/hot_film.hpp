// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Objects that warm the film by more than can be told from a force.
#pragma once

#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/contact_surroundings.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/flags.hpp"

namespace posfet {

/// Knows whether what touches has shown that it is hot: what touches next may be as hot, until a touch that lasts shows
/// nothing of that kind.
class HotFilm {
public:
  /// Share of the warmth of a touch from which the film of a taxel may be warm [1].
  static constexpr double kWarmed = 0.05;

  /// Warmth of touched taxels, with its deviation, above which their forces are not valid [K]: force and warmth are
  /// hardly separable then.
  static constexpr double kGreatestWarmth = 0.08;

  HotFilm(const EstimatedArray& array, const ContactSurroundings& surroundings)
      : array_(array),
        surroundings_(surroundings),

        below_(array.taxels()),
        warm_(array.taxels()) {}

  /// Whether what touches may have warmed the film so much that force and warmth are hardly separable.
  bool may_be_hot(const Belief& belief) const;

  /// Find the taxels whose film may be warm, as something touches them or one beside them, or has just done so: by the
  /// warmth of each, relative to that of a long touch [1], by what is touched or `beside` the present touch, and by
  /// what it held below zero, whose force, and so whose warmth, is unknown. Overwritten by the next call.
  const TaxelFlags& find_warm(const std::vector<double>& warmth, const TaxelFlags& beside);

  /// Keep the taxels that a hot film may hold below zero.
  void hold(const TaxelFlags& below) { below_.set(below.data()); }

  /// Process forces below zero of some taxels [N]; return whether a hot film explains one of them, as a touch may have
  /// warmed it and no object pulls: not one as brief as what looks like a touch where an unknown force is released, nor
  /// one since before an interruption, of which a part may have leaked unseen.
  bool explains(const TaxelFlags& below, const std::vector<double>& force, const std::vector<double>& warmth,
                const TaxelFlags& beside);

  /// Process a block of some duration [s] in which something touches, or nothing.
  void follow(bool touches, double duration);

  /// Record that an unknown time has passed: what touches now may have begun before.
  void interrupt();

  /// Forget what touches have shown.
  void forget();

private:
  const EstimatedArray& array_;
  const ContactSurroundings& surroundings_;
  bool hot_ = false;    ///< Whether this or the last touch has shown a hot film.
  bool shown_ = false;  ///< Whether the present touch has shown one.
  bool touches_ = false;
  bool begun_ = false;        ///< Whether the beginning of the present or last touch was seen.
  double touched_for_ = 0.0;  ///< How long this or the last touch has lasted [s].
  TaxelFlags below_;          ///< Taxels that a hot film may hold below zero.
  TaxelFlags warm_;
};

}  // namespace posfet
