// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/contacts_cdr.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace posfet {

namespace {

constexpr std::array<std::uint8_t, 4> kEncoding{0, 1, 0, 0};
constexpr std::int64_t kNanoseconds = 1'000'000'000;

/// Whole seconds, and the rest [ns], of a time [ns].
struct Time {
  std::int32_t seconds;
  std::uint32_t nanoseconds;
};

Time time_of(std::int64_t nanoseconds) {
  const std::int64_t rest = nanoseconds % kNanoseconds;
  const std::int64_t positive = rest < 0 ? rest + kNanoseconds : rest;
  const std::int64_t seconds = nanoseconds / kNanoseconds - (rest < 0 ? 1 : 0);
  constexpr std::int64_t kLeast = std::numeric_limits<std::int32_t>::min();
  constexpr std::int64_t kMost = std::numeric_limits<std::int32_t>::max();
  return {static_cast<std::int32_t>(std::clamp(seconds, kLeast, kMost)), static_cast<std::uint32_t>(positive)};
}

/// Nanoseconds of a time [s], at most as many as a message holds.
std::int64_t nanoseconds(double seconds) {
  constexpr double kMost = 2147483647.0;
  const double within = seconds > 0.0 ? std::min(seconds, kMost) : 0.0;  // NaN: 0
  return static_cast<std::int64_t>(std::nearbyint(within * 1e9));
}

}  // namespace

ContactsWriter::ContactsWriter(ContactsHeader header)
    : header_(std::move(header)), flat_(std::isinf(header_.surface.radius)) {}

const std::vector<std::uint8_t>& ContactsWriter::write(std::int64_t stamp, std::uint64_t sequence, bool valid,
                                                       const Vector<Contact>& contacts, bool shows_released,
                                                       const Motions& motions) {
  const auto is_shown = [&](const Contact& contact) {
    return shows_released || contact.state != ContactState::kReleased;
  };
  buffer_.assign(kEncoding.begin(), kEncoding.end());
  const Time time = time_of(stamp);
  put(time.seconds);
  put(time.nanoseconds);
  put_text(header_.frame);
  put(header_.layout);
  put(sequence);
  put_text(header_.name);
  put(static_cast<std::uint32_t>(std::count_if(contacts.begin(), contacts.end(), is_shown)));
  for (const Contact& contact : contacts) {
    if (is_shown(contact)) {
      const auto motion = motions.find(contact.id);
      write_contact(contact, motion == motions.end() ? Motion{} : motion->second);
    }
  }
  put_float(header_.threshold);
  put_float(header_.deadband);
  put(static_cast<std::uint8_t>(valid ? 1 : 0));
  return buffer_;
}

void ContactsWriter::write_contact(const Contact& contact, const Motion& motion) {
  const Region& region = contact.region;
  put(contact.id);
  put(static_cast<std::uint8_t>(contact.state));
  put(static_cast<std::uint32_t>(contact.merged.size()));
  for (const Merged& past : contact.merged) {
    put(past.id);
  }
  put(contact.split_from);
  write_geometry(contact);
  put(static_cast<std::uint8_t>(motion.slipping ? 1 : 0));
  put_float(std::sqrt(motion.power));
  const Time age = time_of(nanoseconds(contact.age));
  put(age.seconds);
  put(age.nanoseconds);
  put(static_cast<std::uint32_t>(region.taxels.size()));
  for (const Taxel taxel : region.taxels) {
    put(static_cast<std::uint16_t>(taxel));
  }
}

/// Write the fields from the centre of pressure to the velocity. Only the normal force is measured: `force` is that
/// alone, and its covariance is 0 where it is unknown, as in sensor_msgs/Imu.
void ContactsWriter::write_geometry(const Contact& contact) {
  const Region& region = contact.region;
  const Point& centre = region.centre_of_pressure;
  const Spatial outward = normal(centre);
  const double variance = std::isnan(region.force_variance) ? 0.0 : region.force_variance;
  put_vector(point(centre));
  put_vector(point(region.geometric_centre));
  put_vector(outward);
  if (flat_) {
    put_vector({0.0, 0.0, -region.force});
  } else {
    put_vector({-region.force * outward.x, -region.force * outward.y, -region.force * outward.z});
  }
  for (const double row : {outward.x, outward.y, outward.z}) {
    put_vector({variance * row * outward.x, variance * row * outward.y, variance * row * outward.z});
  }
  put_float(std::sqrt(region.force_variance));
  put_float(region.area);
  put_float(region.peak_pressure);
  put_vector(along(centre, region.axes.major));
  put_vector(along(centre, region.axes.minor));
  Spatial velocity = along(centre, contact.velocity);
  if (flat_ && std::isnan(contact.velocity.x)) {
    velocity.z = contact.velocity.x;
  }
  put_vector(velocity);
}

/// Coordinates in space of a point of the surface [m].
ContactsWriter::Spatial ContactsWriter::point(const Point& at) const {
  if (flat_) {
    return {at.x, at.y, 0.0};
  }
  const double radius = header_.surface.radius;
  const double half = std::sin(0.5 * tilt(at));
  const double out = radius * std::sin(tilt(at));
  const double down = -2.0 * radius * (half * half);
  return header_.surface.axis_x ? Spatial{at.x, out, down} : Spatial{out, at.y, down};
}

/// Components in space of a vector that is tangent to the surface at a point.
ContactsWriter::Spatial ContactsWriter::along(const Point& at, const Point& vector) const {
  if (flat_) {
    return {vector.x, vector.y, 0.0};
  }
  const double sine = std::sin(tilt(at));
  const double cosine = std::cos(tilt(at));
  return header_.surface.axis_x ? Spatial{vector.x, vector.y * cosine, -vector.y * sine}
                                : Spatial{vector.x * cosine, vector.y, -vector.x * sine};
}

/// Outward unit normal at a point.
ContactsWriter::Spatial ContactsWriter::normal(const Point& at) const {
  if (flat_) {
    return {0.0, 0.0, 1.0};
  }
  const double sine = std::sin(tilt(at));
  const double cosine = std::cos(tilt(at));
  return header_.surface.axis_x ? Spatial{0.0, sine, cosine} : Spatial{sine, 0.0, cosine};
}

/// Angle between z and the normal at a point [rad].
double ContactsWriter::tilt(const Point& at) const {
  return (header_.surface.axis_x ? at.y : at.x) / header_.surface.radius;
}

template <typename Number>
void ContactsWriter::put(Number number) {
  align(sizeof(Number));
  std::array<std::uint8_t, sizeof(Number)> bytes{};
  std::memcpy(bytes.data(), &number, sizeof(Number));  // little-endian, as the processors that ROS 2 runs on
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

void ContactsWriter::put_float(double number) {
  constexpr double kMost = std::numeric_limits<float>::max();
  const bool fits = std::abs(number) <= kMost || std::isnan(number);
  put(fits ? static_cast<float>(number)
           : std::copysign(std::numeric_limits<float>::infinity(), static_cast<float>(number > 0.0 ? 1.0 : -1.0)));
}

void ContactsWriter::put_vector(const Spatial& vector) {
  put(vector.x);
  put(vector.y);
  put(vector.z);
}

void ContactsWriter::put_text(const std::string& text) {
  put(static_cast<std::uint32_t>(text.size() + 1));
  buffer_.insert(buffer_.end(), text.begin(), text.end());
  buffer_.push_back(0);
}

/// Add zeros up to a multiple of `size` from the end of the encapsulation header.
void ContactsWriter::align(std::size_t size) {
  const std::size_t past = (buffer_.size() - kEncoding.size()) % size;
  if (past != 0) {
    buffer_.resize(buffer_.size() + size - past, 0);
  }
}

}  // namespace posfet
