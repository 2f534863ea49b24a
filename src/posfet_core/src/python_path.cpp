// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "posfet_core/contacts_cdr.hpp"
#include "posfet_core/scan_path.hpp"
#include "python_arrays.hpp"
#include "python_bindings.hpp"
#include "python_contacts.hpp"
#include "python_scan.hpp"

namespace posfet {

namespace {

py::tuple result_of(const ScanPath& path) {
  const ScanResult& result = path.result();
  return py::make_tuple(result.accepted, result.unusable, result.valid, static_cast<int>(result.reasons),
                        result.saturated, result.stamp, result.sequence);
}

py::tuple contacts_of(const ScanPath& path) {
  py::list found;
  for (const Contact& contact : path.contacts()) {
    if (path.shows_released() || contact.state != ContactState::kReleased) {
      found.append(to_python(contact));
    }
  }
  return py::tuple(found);
}

void set_faulty(ScanPath& path, const Flags& unlisted, const Flags& interpolated) {
  const auto taxels = static_cast<Taxel>(path.taxels());
  if (unlisted.has_value() != interpolated.has_value()) {
    throw std::invalid_argument("unlisted and interpolated must both be given, or neither");
  }
  path.set_faulty(flags_of(unlisted, taxels, "unlisted"), flags_of(interpolated, taxels, "interpolated"));
}

void bind_path(const py::module_& module) {
  py::class_<ScanPath, std::shared_ptr<ScanPath>>(module, "ScanPath",
                                                  "Forces and contacts of one sensor, scan by scan.")
      .def(py::init([](std::shared_ptr<ScanClock> clock, std::shared_ptr<CrosstalkCompensator> crosstalk,
                       std::shared_ptr<BurstDetector> bursts, std::shared_ptr<HumFilter> hum,
                       std::shared_ptr<ForceIntegration> integration, std::shared_ptr<CountHistory> history,
                       std::shared_ptr<ContactFinder> finder, std::shared_ptr<ContactTracker> tracker,
                       std::shared_ptr<DynamicChannel> channel, double volts_of_zero, double volts_per_count,
                       double gain, double amplifier_offset, double capacitance, int saturated_low, int saturated_high,
                       const Values& offset, double informative, double most_x, double most_y) {
             ScanParts parts{std::move(clock),  std::move(crosstalk),   std::move(bursts),
                             std::move(hum),    std::move(integration), std::move(history),
                             std::move(finder), std::move(tracker),     std::move(channel)};
             return std::make_shared<ScanPath>(
                 std::move(parts),
                 InverseSignalChain{volts_of_zero, volts_per_count, gain, amplifier_offset, capacitance, saturated_low,
                                    saturated_high},
                 vector_of(offset), InterpolationLimits{informative, most_x, most_y});
           }),
           py::kw_only(), py::arg("clock"), py::arg("crosstalk"), py::arg("bursts"), py::arg("hum"),
           py::arg("integration"), py::arg("history"), py::arg("finder"), py::arg("tracker"), py::arg("channel"),
           py::arg("volts_of_zero"), py::arg("volts_per_count"), py::arg("gain"), py::arg("amplifier_offset"),
           py::arg("capacitance"), py::arg("saturated_low"), py::arg("saturated_high"), py::arg("offset"),
           py::arg("informative"), py::arg("most_x"), py::arg("most_y"))
      .def(
          "receive", [](ScanPath& path, const py::object& scan) { return path.receive(PythonScan(scan).scan()); },
          py::arg("scan"), "Take a scan; return whether it is neither duplicate nor late.")
      .def(
          "begin", [](ScanPath& path, const py::object& scan) { return path.begin(PythonScan(scan).scan()); },
          py::arg("scan"), "Process the scan up to its forces; return whether it has a predecessor.")
      .def("finish", &ScanPath::finish, "Find and follow the contacts of the scan that was begun.")
      .def_property_readonly(
          "charge",
          [](const py::object& self) {
            auto& path = self.cast<ScanPath&>();
            return view_of(path.charge().data(), {static_cast<py::ssize_t>(path.taxels())}, self);
          },
          "Charge densities of the scan after compensation [C/m2].")
      .def_property_readonly("result", &result_of,
                             "Whether the newest scan was accepted, unusable, is valid, why not, how many taxels are "
                             "saturated, its stamp and sequence.")
      .def_property_readonly("contacts", &contacts_of, "Contacts of the result, a new tuple.")
      .def_property_readonly(
          "motions", [](const ScanPath& path) { return to_python(path.motions()); },
          "Vibration and slip of each contact, by its id; a new dictionary.")
      .def_property_readonly("blank", &ScanPath::blank,
                             "Whether the newest scan that was neither duplicate nor late was unusable.")
      .def_readwrite("vibration_wanted", &ScanPath::vibration_wanted,
                     "Whether the dynamic channel runs while nothing touches, too.")
      .def_property_readonly(
          "saturated", [](const py::object& self) { return view_of(self.cast<ScanPath&>().saturated(), self); },
          "Taxels at the end of their range in the last scan that was read.")
      .def_property_readonly(
          "interpolated", [](const py::object& self) { return view_of(self.cast<ScanPath&>().interpolated(), self); },
          "Faulty taxels whose forces are interpolated.")
      .def_property_readonly(
          "filled_deviation",
          [](const py::object& self) {
            auto& path = self.cast<ScanPath&>();
            return view_of(path.filled_deviation().data(), {static_cast<py::ssize_t>(path.taxels())}, self);
          },
          "Standard uncertainty of each interpolated force [N]; up to date while there are such.")
      .def_property_readonly(
          "filled",
          [](const py::object& self) {
            auto& path = self.cast<ScanPath&>();
            return view_of(path.filled().data(), {static_cast<py::ssize_t>(path.taxels())}, self);
          },
          "Forces of the taxels with those of faulty ones interpolated [N].")
      .def("set_hum", &ScanPath::set_hum, py::arg("hum"), "Use another filter of the mains hum.")
      .def("set_faulty", &set_faulty, py::arg("unlisted"), py::arg("interpolated"),
           "Set the faulty taxels, and those among them that are interpolated; None for none.")
      .def(
          "set_variance",
          [](ScanPath& path, const Values& variance) {
            path.set_variance(values_of(variance, static_cast<Taxel>(path.taxels()), "variance"));
          },
          py::arg("variance"), "Set the variance of each force that it does not share with others [N2].");
}

py::bytes bytes_of(const std::vector<std::uint8_t>& buffer) {
  return {reinterpret_cast<const char*>(buffer.data()), buffer.size()};
}

py::bytes write_scan(ContactsWriter& writer, const ScanPath& path) {
  const ScanResult& result = path.result();
  return bytes_of(writer.write(result.stamp, result.sequence, result.valid, path.contacts(), path.shows_released(),
                               path.motions()));
}

py::bytes write_contacts(ContactsWriter& writer, const py::int_& stamp, const py::int_& sequence, bool valid,
                         const py::sequence& contacts, const py::dict& motions) {
  Vector<Contact> listed;
  std::transform(contacts.begin(), contacts.end(), std::back_inserter(listed), contact_from);
  Motions known;
  for (const auto& [id, motion] : motions) {
    known[py::cast<TrackId>(id)] = motion_from(motion);
  }
  return bytes_of(writer.write(signed_of(stamp), unsigned_of(sequence), valid, listed, true, known));
}

void bind_contacts_writer(const py::module_& module) {
  py::class_<ContactsWriter>(module, "ContactsWriter", "Serialises the contacts of one array.")
      .def(py::init([](std::string frame, std::uint32_t layout, std::string name, double threshold, double deadband,
                       double radius, bool axis_x) {
             return std::make_unique<ContactsWriter>(ContactsHeader{std::move(frame), layout, std::move(name),
                                                                    threshold, deadband, Surface{radius, axis_x}});
           }),
           py::kw_only(), py::arg("frame"), py::arg("layout_id"), py::arg("name"), py::arg("threshold"),
           py::arg("deadband"), py::arg("radius"), py::arg("axis_x"))
      .def("write_scan", &write_scan, py::arg("path"), "Return the serialised message of the last scan of a path.")
      .def("write_contacts", &write_contacts, py::arg("stamp"), py::arg("sequence"), py::arg("valid"),
           py::arg("contacts"), py::arg("motions"), "Return the serialised message of given contacts.");
}

}  // namespace

void bind_scan_path(const py::module_& module) {
  bind_path(module);
  bind_contacts_writer(module);
}

}  // namespace posfet
