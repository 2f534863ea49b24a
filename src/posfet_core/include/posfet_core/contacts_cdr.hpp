// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Serialised message posfet_msgs/TactileContacts in one buffer.
///
/// Little-endian CDR, encoding version 1 (OMG, DDS-XTypes 1.3, section 7.4.3), with alignment relative to the end of
/// the four-byte encapsulation header.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "posfet_core/contact.hpp"
#include "posfet_core/slip.hpp"

namespace posfet {

/// Geometry of the touched surface: flat, or bent to a cylinder with the array on its outer side. Positions on the
/// array are arc lengths; in space, x is along columns, y along rows, z outward from the middle of the array.
struct Surface {
  double radius;  ///< Radius of the cylinder [m]; inf: flat.
  bool axis_x;    ///< Whether its axis is parallel to x, so that the columns are bent; else to y.
};

/// What is the same in each message.
struct ContactsHeader {
  std::string frame;     ///< Frame of the array.
  std::uint32_t layout;  ///< Identifier of the layout.
  std::string name;      ///< Name of the sensor.
  double threshold;      ///< Contact threshold [N].
  double deadband;       ///< [N].
  Surface surface;
};

/// Writes the contacts of a scan into a buffer that it owns.
class ContactsWriter {
public:
  explicit ContactsWriter(ContactsHeader header);

  /// The serialised message, overwritten by the next one: of a scan at `stamp` [ns] with a sequence number, whether its
  /// forces are valid, its contacts, the released ones only if they are shown, and their motions.
  const std::vector<std::uint8_t>& write(std::int64_t stamp, std::uint64_t sequence, bool valid,
                                         const Vector<Contact>& contacts, bool shows_released, const Motions& motions);

private:
  /// Vector in space.
  struct Spatial {
    double x;
    double y;
    double z;
  };

  void write_contact(const Contact& contact, const Motion& motion);
  void write_geometry(const Contact& contact);
  Spatial point(const Point& at) const;
  Spatial along(const Point& at, const Point& vector) const;
  Spatial normal(const Point& at) const;
  double tilt(const Point& at) const;

  template <typename Number>
  void put(Number number);
  void put_float(double number);
  void put_vector(const Spatial& vector);
  void put_text(const std::string& text);
  void align(std::size_t size);

  ContactsHeader header_;
  bool flat_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace posfet
