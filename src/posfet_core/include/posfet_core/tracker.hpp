// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Contact tracking from scan to scan: track ids that persist through motion, merge and split; state, velocity, age.
///
/// Where two contacts merge into one region the older one continues and stores the other; when the region splits again
/// close to the merge, the stored contact is restored with its id and age. A contact that splits off and was never
/// stored gets a new id, and refers to the one that it split off from.
#pragma once

#include <cstddef>
#include <limits>

#include "posfet_core/assignment.hpp"
#include "posfet_core/contact.hpp"
#include "posfet_core/detection.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Greatest id; the next one is 1.
constexpr TrackId kLastId = std::numeric_limits<TrackId>::max();

/// Standard deviations of the velocity's noise that do not count as motion [1].
constexpr double kNoiseDeviations = 4.0;

/// Number of taxels whose noise contributes to one coordinate of a fingertip's centre of pressure [1], assumed.
constexpr double kTaxelsAcross = 3.0;

/// A contact with less force than this when it ends was released, and did not merge with another [contact threshold].
constexpr double kReleasedForce = 2.0;

/// Greatest number of contacts that one stores [1], assumed: more than two hands have fingertips. Of more, those that
/// merged first have ended: a contact that is held for long while others come and go beside it stores no more.
constexpr std::size_t kMostMerged = 16;

/// Settings of data association and motion detection, and what they depend on.
struct TrackerSettings {
  double gate;         ///< Greatest distance of the centre of pressure between scans for the same contact [pitch].
  double smoothing;    ///< Time constant of the velocity's low-pass [s].
  double start_speed;  ///< A contact moves from this speed on [m/s].
  double stop_speed;   ///< A moving contact is held again below this speed [m/s].
  double pitch;        ///< Greatest pitch of the array [m].
  double threshold;    ///< Contact threshold [N].
  double noise;        ///< Standard deviation of a reading [N].
};

/// Data association of regions with contacts by the least sum of squared distances of the centres of pressure.
class ContactTracker {
public:
  /// `first_id` is the id of the first contact, in [1, kLastId].
  ContactTracker(const TrackerSettings& settings, TrackId first_id);

  /// Id of the next contact.
  TrackId next_id() const { return next_id_; }

  /// Associate the regions of a scan with the contacts of the scan before, `step` seconds ago, > 0. Returns the
  /// contacts, ascending by id; those that ended in this scan are included once, as released.
  const Vector<Contact>& update(Vector<Region> regions, double step);

  /// Measure the regions of a scan and update the contacts with them.
  const Vector<Contact>& follow(ContactFinder& finder, const ForceEstimate& taxels, double step);

  /// Contacts of the last scan; those that ended in it are included.
  const Vector<Contact>& contacts() const { return reported_; }

  /// Whether there is no contact that could continue or be released.
  bool idle() const;

private:
  using Pairs = Vector<Pair>;          ///< Contact and region of each association.
  using Followed = Map<int, Contact>;  ///< Contacts of this scan, by their regions.

  const Contact& contact(int track) const { return reported_[static_cast<std::size_t>(track)]; }
  void forget_released();
  Pairs associate(const Vector<Region>& regions) const;
  Vector<Contact> change(Pairs pairs, const Vector<Region>& regions, double step);
  Pairs merging(const Pairs& pairs, const Vector<Region>& regions) const;
  void merge(const Pairs& merging, const Pairs& pairs, Followed& followed) const;
  void split(int index, const Vector<Region>& regions, const Pairs& pairs, Followed& followed);
  Contact begin(const Region& region, TrackId split_from);
  Contact followed(const Contact& contact, Region region, double step) const;

  TrackerSettings settings_;
  double gate_;   ///< [m].
  double noise_;  ///< Speed that noise may cause, times the force of the contact [N m/s].
  Vector<Contact> reported_;
  TrackId next_id_;
};

}  // namespace posfet
