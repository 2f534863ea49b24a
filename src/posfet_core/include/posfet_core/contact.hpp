// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Contacts: what is reported of each in a scan.
#pragma once

#include <cstdint>

#include "posfet_core/grid.hpp"
#include "posfet_core/moments.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// One connected region in contact, in the frame of the array.
struct Region {
  Taxels touched;  ///< Taxels in contact.
  Taxels taxels;   ///< Taxels that it lists: those, or the neighbours of a noisy one.
  Point centre_of_pressure;
  Point geometric_centre;       ///< Mean position of the taxels that it lists.
  double force = 0.0;           ///< Normal force, positive when pushed [N]; NaN when a taxel's force is unknown.
  double force_variance = 0.0;  ///< [N2]; NaN with a saturated taxel, whose force is a lower bound.
  double area = 0.0;            ///< Area of the cells of the taxels that it lists [m2].
  double peak_pressure = 0.0;  ///< Greatest force of a taxel over the area of a taxel [Pa]; NaN with a saturated taxel,
                               ///< or where that taxel is interpolated.
  Axes axes;                   ///< Principal axes of the force distribution.
  bool separated = false;      ///< Whether a saddle separated it from others in the same connected region.
};

/// State of a contact; the values are those of STATE_* in posfet_msgs/TactileContact.
enum class ContactState : std::uint8_t { kNew = 0, kHeld = 1, kMoving = 2, kReleased = 3 };

/// Track id, from 1; 0 is none.
using TrackId = std::uint32_t;

/// A contact that merged into another.
struct Merged {
  TrackId id = 0;
  double age = 0.0;        ///< Its age at the merge, less that of the contact that it merged into [s].
  Point offset;            ///< Its centre of pressure at the merge, from that of the contact that it merged into.
  TrackId split_from = 0;  ///< Id of the contact that it split off from.
};

/// One contact at the time of a scan.
struct Contact {
  TrackId id = 0;
  ContactState state = ContactState::kNew;
  Region region;           ///< Geometry and force; of a released contact the last geometry, with force 0.
  Point velocity;          ///< Of the centre of pressure [m/s], low-pass filtered; NaN in the first scan.
  double age = 0.0;        ///< Time since the contact began [s].
  Vector<Merged> merged;   ///< Contacts that merged into this one, in order; the last ones of many (`kMostMerged`).
  TrackId split_from = 0;  ///< Id of the contact that this one split off from.
};

}  // namespace posfet
