// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// What takes scans without Python, for Python.

#include <pybind11/pybind11.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <stdexcept>

#include "posfet_core/contacts_sink.hpp"
#include "python_bindings.hpp"
#include "python_mutex.hpp"

namespace posfet {

namespace py = pybind11;

namespace {

/// What lies at an address that Python has.
template <typename Pointer>
Pointer at_address(std::uintptr_t address) {
  return reinterpret_cast<Pointer>(address);  // NOLINT(performance-no-int-to-ptr): rclpy and ctypes give integers
}

void publish_with(ContactsSink& sink, std::uintptr_t publish, std::uintptr_t reset_error, std::uintptr_t publisher) {
  if (publish == 0 || reset_error == 0) {
    throw std::invalid_argument("publish and reset_error must be addresses of functions");
  }
  Publishing publishing;
  publishing.publish = at_address<decltype(publishing.publish)>(publish);
  publishing.reset_error = at_address<decltype(publishing.reset_error)>(reset_error);
  publishing.publisher = at_address<const void*>(publisher);
  sink.set_publishing(publishing);
}

}  // namespace

void bind_sink(const py::module_& module) {
  py::class_<std::mutex>(module, "Mutex", py::module_local(), "A mutex as a context manager.")
      .def(py::init<>())
      .def("__enter__", [](std::mutex& mutex) { acquire(mutex); })
      .def("__exit__", [](std::mutex& mutex, const py::args& /*error*/) { mutex.unlock(); });
  py::class_<ContactsSink>(module, "ContactsSink", "Takes scans without Python, and publishes their contacts.")
      .def(py::init<Reconstructor&, ContactsWriter&, std::mutex&>(), py::arg("reconstructor"), py::arg("writer"),
           py::arg("mutex"), py::keep_alive<1, 2>(), py::keep_alive<1, 3>(), py::keep_alive<1, 4>())
      .def("publish_with", &publish_with, py::arg("publish"), py::arg("reset_error"), py::arg("publisher"),
           "Set the addresses of rcl's functions and of the publisher; 0: no publisher.")
      .def("close", &ContactsSink::close, "Refuse all further scans.")
      .def("take_failure", &ContactsSink::take_failure,
           "Return whether the contacts of the newest scan could not be published, and forget it.")
      .def_property_readonly("capsule", [](const py::object& self) {
        return py::capsule(&self.cast<const ContactsSink&>().sink(), kScanSinkName);
      });
}

}  // namespace posfet
