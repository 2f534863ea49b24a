// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What an object that leaves does to the temperature of the chip.
#pragma once

namespace posfet {

/// Follows by how much the rate of the chip's temperature has changed since an object came.
///
/// The object that warms a chip ends that as it leaves: the rate changes by as much as it did when the object came, or
/// has since. A filter that does not expect it explains the fall of the untouched taxels by what the object lets them
/// feel.
class ObjectHeating {
public:
  /// Process a block in which the force changed from one to another [N], at a rate of the temperature with its
  /// deviation and the rate some blocks ago [K/s]. Returns by how much the rate may change as the force falls [K/s/N].
  double update(double before, double force, double rate, double deviation, double earlier);

private:
  double usual_ = 0.0;     ///< Rate before the touch [K/s].
  double greatest_ = 0.0;  ///< Greatest force of the touch [N].
};

}  // namespace posfet
