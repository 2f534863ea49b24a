// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/tracker.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace posfet {

namespace {

constexpr double kNotYet = std::numeric_limits<double>::quiet_NaN();

bool is_released(const Contact& contact) { return contact.state == ContactState::kReleased; }

double distance(const Contact& contact, const Region& region) {
  const Point& was = contact.region.centre_of_pressure;
  const Point& now = region.centre_of_pressure;
  return std::hypot(was.x - now.x, was.y - now.y);
}

Point between(const Region& from, const Region& to) {
  return {to.centre_of_pressure.x - from.centre_of_pressure.x, to.centre_of_pressure.y - from.centre_of_pressure.y};
}

double along(const Merged& past, const Point& direction) {
  return past.offset.x * direction.x + past.offset.y * direction.y;
}

const Pair* with_track(const Vector<Pair>& pairs, int track) {
  const auto found = std::find_if(pairs.begin(), pairs.end(), [&](const Pair& pair) { return pair.first == track; });
  return found == pairs.end() ? nullptr : &*found;
}

const Pair* with_region(const Vector<Pair>& pairs, int index) {
  const auto found = std::find_if(pairs.begin(), pairs.end(), [&](const Pair& pair) { return pair.second == index; });
  return found == pairs.end() ? nullptr : &*found;
}

/// Give a contact whose centre jumped by a merge or split its previous state and velocity.
void keep_motion(Contact& contact, const Contact& before) {
  const bool fresh = before.state == ContactState::kNew;
  contact.state = fresh ? ContactState::kHeld : before.state;
  contact.velocity = fresh ? Point{} : before.velocity;
}

/// Store a contact that merged into another one, and those that had merged into it, by their state before the merge.
void store(Vector<Merged>& merged, const Contact& gone, const Contact& stays) {
  const Point offset = between(stays.region, gone.region);
  const double later = gone.age - stays.age;
  merged.push_back({gone.id, later, offset, gone.split_from});
  for (const Merged& past : gone.merged) {
    merged.push_back({past.id, past.age + later, offset, past.split_from});
  }
  if (merged.size() > kMostMerged) {
    merged.erase(merged.begin(), merged.end() - static_cast<std::ptrdiff_t>(kMostMerged));
  }
}

Contact released(const Contact& contact, double step) {
  Contact ended = contact;
  ended.state = ContactState::kReleased;
  ended.region.force = 0.0;
  ended.region.peak_pressure = 0.0;
  ended.age += step;
  return ended;
}

/// Restore the contact that had merged into that of region `other` from the direction in which region `index` lies,
/// which was one with it in the scan `before`.
void restore(int index, int other, const Contact& before, const Vector<Region>& regions, Map<int, Contact>& followed) {
  const auto at = [&](int number) -> const Region& { return regions[static_cast<std::size_t>(number)]; };
  Contact stays = std::move(followed.at(other));
  const Point direction = between(at(other), at(index));
  const auto back = std::max_element(
      stays.merged.begin(), stays.merged.end(),
      [&](const Merged& one, const Merged& another) { return along(one, direction) < along(another, direction); });
  const Merged past = *back;
  stays.merged.erase(back);
  const bool opposite = along(past, direction) < 0.0;
  const int staying = opposite ? index : other;
  const int restored = opposite ? other : index;
  stays.region = at(staying);
  keep_motion(stays, before);
  Contact contact;
  contact.id = past.id;
  contact.state = ContactState::kHeld;
  contact.region = at(restored);
  contact.age = stays.age + past.age;
  contact.split_from = past.split_from;
  followed[staying] = std::move(stays);
  followed[restored] = std::move(contact);
}

}  // namespace

ContactTracker::ContactTracker(const TrackerSettings& settings, TrackId first_id)
    : settings_(settings),
      gate_(settings.gate * settings.pitch),
      noise_(kNoiseDeviations * kTaxelsAcross * settings.pitch * settings.noise / settings.smoothing),
      next_id_(first_id) {}

bool ContactTracker::idle() const { return std::all_of(reported_.begin(), reported_.end(), is_released); }

const Vector<Contact>& ContactTracker::follow(ContactFinder& finder, const ForceEstimate& taxels, double step) {
  forget_released();
  KnownRegions before;
  for (const Contact& contact : reported_) {
    before.push_back(&contact.region);
  }
  return update(finder.measure(taxels, before), step);
}

const Vector<Contact>& ContactTracker::update(Vector<Region> regions, double step) {
  forget_released();
  Pairs pairs = associate(regions);
  if (pairs.size() == regions.size() && pairs.size() == reported_.size()) {
    for (const auto& [track, index] : pairs) {
      Contact& contact = reported_[static_cast<std::size_t>(track)];
      contact = followed(contact, std::move(regions[static_cast<std::size_t>(index)]), step);
    }
  } else {
    reported_ = change(std::move(pairs), regions, step);
  }
  return reported_;
}

void ContactTracker::forget_released() {
  reported_.erase(std::remove_if(reported_.begin(), reported_.end(), is_released), reported_.end());
}

/// The region of each contact that continues, by the least sum of squared distances; ascending by contact.
ContactTracker::Pairs ContactTracker::associate(const Vector<Region>& regions) const {
  Vector<Vector<double>> distances;
  Pairs pairs;
  Set<int> taken;
  for (std::size_t track = 0; track < reported_.size(); ++track) {
    Vector<double>& row = distances.emplace_back();
    for (const Region& region : regions) {
      row.push_back(distance(reported_[track], region));
    }
    const auto nearest = std::min_element(row.begin(), row.end());
    if (nearest != row.end() && *nearest <= gate_) {
      pairs.emplace_back(static_cast<int>(track), static_cast<int>(nearest - row.begin()));
      taken.insert(pairs.back().second);
    }
  }
  if (taken.size() == pairs.size()) {
    return pairs;
  }
  for (Vector<double>& row : distances) {
    std::transform(row.begin(), row.end(), row.begin(), [](double each) { return each * each; });
  }
  // A contact that ends costs as much as the longest distance within the gate.
  return minimum_cost_assignment(distances, gate_ * gate_);
}

/// Update contacts of which some begin, end, merge or split; return them, ascending by id.
Vector<Contact> ContactTracker::change(Pairs pairs, const Vector<Region>& regions, double step) {
  const Pairs merging = this->merging(pairs, regions);
  for (const auto& [track, into] : merging) {
    // The older one continues, wherever the common centre is.
    if (contact(track).age > contact(into).age) {
      const auto other = std::find_if(pairs.begin(), pairs.end(), [&](const Pair& pair) { return pair.first == into; });
      const Pair older{track, other->second};
      pairs.erase(other);
      pairs.push_back(older);
    }
  }
  Followed continuing;
  for (const auto& [track, index] : pairs) {
    continuing.emplace(index, followed(contact(track), regions[static_cast<std::size_t>(index)], step));
  }
  merge(merging, pairs, continuing);
  Vector<Contact> all;
  for (int track = 0; track < static_cast<int>(reported_.size()); ++track) {
    const Pair* merged = with_track(merging, track);
    const bool absorbed = merged != nullptr || with_region(merging, track) != nullptr;
    if (with_track(pairs, track) == nullptr && !absorbed) {
      all.push_back(released(contact(track), step));
    }
  }
  for (int index = 0; index < static_cast<int>(regions.size()); ++index) {
    if (continuing.count(index) == 0) {
      split(index, regions, pairs, continuing);
    }
  }
  for (auto& [index, each] : continuing) {
    all.push_back(std::move(each));
  }
  std::sort(all.begin(), all.end(), [](const Contact& one, const Contact& other) { return one.id < other.id; });
  return all;
}

/// For each contact without a region, the contact whose region contains it.
ContactTracker::Pairs ContactTracker::merging(const Pairs& pairs, const Vector<Region>& regions) const {
  Pairs found;
  for (int track = 0; track < static_cast<int>(reported_.size()); ++track) {
    const Region& region = contact(track).region;
    if (with_track(pairs, track) != nullptr || region.force < kReleasedForce * settings_.threshold) {
      continue;
    }
    for (int index = 0; index < static_cast<int>(regions.size()); ++index) {
      const Region& now = regions[static_cast<std::size_t>(index)];
      const Pair* owner = with_region(pairs, index);
      if (owner != nullptr && intersect(region.touched, now.touched) && with_region(found, owner->first) == nullptr) {
        // The region carries the force of both; otherwise one was released beside the other.
        if (now.force >= contact(owner->first).region.force + 0.5 * region.force) {
          found.emplace_back(track, owner->first);
        }
        break;
      }
    }
  }
  return found;
}

/// Store the contacts that merged in those that continue.
void ContactTracker::merge(const Pairs& merging, const Pairs& pairs, Followed& followed) const {
  for (const auto& [track, into] : merging) {
    const Pair* own = with_track(pairs, track);
    const int stays = own != nullptr ? track : into;
    const int goes = own != nullptr ? into : track;
    Contact& now = followed.at(with_track(pairs, stays)->second);
    keep_motion(now, contact(stays));
    store(now.merged, contact(goes), contact(stays));
  }
}

/// Add the contact of a region without association: one that is restored, splits off, or is new.
void ContactTracker::split(int index, const Vector<Region>& regions, const Pairs& pairs, Followed& followed) {
  const Region& region = regions[static_cast<std::size_t>(index)];
  const auto overlapping = std::find_if(pairs.begin(), pairs.end(), [&](const Pair& pair) {
    return intersect(contact(pair.first).region.touched, region.touched);
  });
  if (overlapping == pairs.end()) {
    followed[index] = begin(region, 0);
    return;
  }
  const auto [track, other] = *overlapping;
  Contact& parent = followed.at(other);
  if (parent.merged.empty()) {
    keep_motion(parent, contact(track));
    followed[index] = begin(region, parent.id);
  } else {
    restore(index, other, contact(track), regions, followed);
  }
}

Contact ContactTracker::begin(const Region& region, TrackId split_from) {
  Contact contact;
  contact.id = next_id_;
  contact.region = region;
  contact.velocity = {kNotYet, kNotYet};
  contact.split_from = split_from;
  next_id_ = next_id_ == kLastId ? 1 : next_id_ + 1;
  return contact;
}

Contact ContactTracker::followed(const Contact& contact, Region region, double step) const {
  const double share = -std::expm1(-step / settings_.smoothing);
  const Point moved = between(contact.region, region);
  const Point old = contact.state == ContactState::kNew ? Point{} : contact.velocity;
  Contact now;
  now.id = contact.id;
  now.velocity = {old.x + share * (moved.x / step - old.x), old.y + share * (moved.y / step - old.y)};
  const double usual = contact.state == ContactState::kMoving ? settings_.stop_speed : settings_.start_speed;
  const double limit = region.force > 0.0 ? std::max(usual, noise_ / region.force) : HUGE_VAL;
  now.state = std::hypot(now.velocity.x, now.velocity.y) > limit ? ContactState::kMoving : ContactState::kHeld;
  now.region = std::move(region);
  now.age = contact.age + step;
  now.merged = contact.merged;
  now.split_from = contact.split_from;
  return now;
}

}  // namespace posfet
