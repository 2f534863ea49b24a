// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Contacts to and from the named tuples of posfet_core/contact.py.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <array>
#include <utility>
#include <vector>

#include "posfet_core/contact.hpp"
#include "posfet_core/slip.hpp"
#include "python_arrays.hpp"

namespace posfet {

/// The types of posfet_core/contact.py, made once and never destroyed: they outlive the interpreter's last call.
struct PythonTypes {
  py::object region, merged, contact, motion;
  std::array<py::object, 4> states;

  static const PythonTypes& get() {
    static const auto* types = new PythonTypes(py::module_::import("posfet_core.contact"));
    return *types;
  }

private:
  explicit PythonTypes(const py::module_& module)
      : region(module.attr("Region")),
        merged(module.attr("Merged")),
        contact(module.attr("Contact")),
        motion(module.attr("Motion")) {
    for (std::size_t value = 0; value < states.size(); ++value) {
      states[value] = module.attr("ContactState")(value);
    }
  }
};

/// A named tuple of the given values, without a call of its Python constructor.
template <typename... Values>
py::object named_tuple(const py::object& type, Values&&... values) {
  const py::tuple arguments = py::make_tuple(py::make_tuple(std::forward<Values>(values)...));
  auto* made = PyTuple_Type.tp_new(reinterpret_cast<PyTypeObject*>(type.ptr()), arguments.ptr(), nullptr);
  if (made == nullptr) {
    throw py::error_already_set();
  }
  return py::reinterpret_steal<py::object>(made);
}

inline py::tuple to_python(const Point& point) { return py::make_tuple(point.x, point.y); }

inline py::object to_python(const Region& region) {
  const py::object taxels = array_of(region.taxels);
  const py::object touched = region.touched == region.taxels ? taxels : array_of(region.touched);
  return named_tuple(PythonTypes::get().region, touched, taxels, to_python(region.centre_of_pressure),
                     to_python(region.geometric_centre), region.force, region.force_variance, region.area,
                     region.peak_pressure, to_python(region.axes.major), to_python(region.axes.minor),
                     region.separated);
}

inline py::object to_python(const Merged& merged) {
  return named_tuple(PythonTypes::get().merged, merged.id, merged.age, to_python(merged.offset), merged.split_from);
}

inline py::object to_python(const Motion& motion) {
  return named_tuple(PythonTypes::get().motion, motion.power, motion.slipping, motion.still);
}

inline py::dict to_python(const Motions& motions) {
  py::dict found;
  for (const auto& [id, motion] : motions) {
    found[py::int_(id)] = to_python(motion);
  }
  return found;
}

/// A tuple with each object of a vector.
template <typename Value>
py::tuple tuple_of(const Vector<Value>& values) {
  py::tuple made(values.size());
  for (std::size_t index = 0; index < values.size(); ++index) {
    made[index] = to_python(values[index]);
  }
  return made;
}

inline py::object to_python(const Contact& contact) {
  return named_tuple(PythonTypes::get().contact, contact.id,
                     PythonTypes::get().states[static_cast<std::size_t>(contact.state)], to_python(contact.region),
                     to_python(contact.velocity), contact.age, tuple_of(contact.merged), contact.split_from);
}

inline Taxels taxels_from(const py::handle& object) {
  const auto array = py::cast<py::array_t<Taxel, py::array::c_style | py::array::forcecast>>(object);
  return Taxels(array.data(), array.data() + array.size());
}

inline Point point_from(const py::handle& object) {
  const auto [x, y] = py::cast<std::pair<double, double>>(object);
  return {x, y};
}

inline Region region_from(const py::handle& object) {
  const auto fields = py::cast<py::tuple>(object);
  Region region;
  region.touched = taxels_from(fields[0]);
  region.taxels = taxels_from(fields[1]);
  region.centre_of_pressure = point_from(fields[2]);
  region.geometric_centre = point_from(fields[3]);
  region.force = py::cast<double>(fields[4]);
  region.force_variance = py::cast<double>(fields[5]);
  region.area = py::cast<double>(fields[6]);
  region.peak_pressure = py::cast<double>(fields[7]);
  region.axes = {point_from(fields[8]), point_from(fields[9])};
  region.separated = py::cast<bool>(fields[10]);
  return region;
}

inline Merged merged_from(const py::handle& object) {
  const auto fields = py::cast<py::tuple>(object);
  return {py::cast<TrackId>(fields[0]), py::cast<double>(fields[1]), point_from(fields[2]),
          py::cast<TrackId>(fields[3])};
}

inline Contact contact_from(const py::handle& object) {
  const auto fields = py::cast<py::tuple>(object);
  Contact contact;
  contact.id = py::cast<TrackId>(fields[0]);
  contact.state = static_cast<ContactState>(py::cast<int>(fields[1]));
  contact.region = region_from(fields[2]);
  contact.velocity = point_from(fields[3]);
  contact.age = py::cast<double>(fields[4]);
  for (const py::handle& past : py::cast<py::tuple>(fields[5])) {
    contact.merged.push_back(merged_from(past));
  }
  contact.split_from = py::cast<TrackId>(fields[6]);
  return contact;
}

inline Motion motion_from(const py::handle& object) {
  const auto fields = py::cast<py::tuple>(object);
  return {py::cast<double>(fields[0]), py::cast<bool>(fields[1]), py::cast<double>(fields[2])};
}

inline Vector<Region> regions_from(const py::sequence& objects) {
  Vector<Region> regions;
  for (const py::handle& object : objects) {
    regions.push_back(region_from(object));
  }
  return regions;
}

}  // namespace posfet
