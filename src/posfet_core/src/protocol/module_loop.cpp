// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// Ports, and the loop that decodes what they read, for Python.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <utility>

#include "../python_mutex.hpp"
#include "posfet_core/protocol/scan_loop.hpp"
#include "python_batch.hpp"
#include "python_frames.hpp"
#include "python_integers.hpp"
#include "python_loop.hpp"

namespace posfet::protocol {

namespace {

/// Longest time that is waited [s]; one call is made again before it is over.
constexpr double kLongestWait = 1e9;

std::int64_t end_after(double timeout) {
  const double seconds = std::isnan(timeout) ? 0.0 : std::min(std::max(timeout, 0.0), kLongestWait);
  return monotonic_now() + static_cast<std::int64_t>(seconds * 1e9);
}

/// Throw OSError for a signal whose handler has raised.
void check_signals() {
  if (PyErr_CheckSignals() != 0) {
    throw py::error_already_set();
  }
}

void throw_failure(const FramePort& port) {
  if (port.ended()) {
    PyErr_SetString(PyExc_EOFError, "end of file");
  } else {
    errno = port.error();
    PyErr_SetFromErrno(PyExc_OSError);
  }
  throw py::error_already_set();
}

/// Wait for what can be read; return false when nothing came up to `end`.
bool wait_for(const FramePort& port, std::int64_t end) {
  while (true) {
    Waited waited = Waited::kTimeout;
    {
      const py::gil_scoped_release waiting;
      waited = wait_until(port.descriptor(), -1, end);
    }
    if (waited != Waited::kInterrupted) {
      return waited == Waited::kReadable;
    }
    check_signals();
  }
}

/// The frames that are waiting, or the first ones within `timeout` [s].
py::list read(FramePort& port, double timeout) {
  py::list frames;
  if (!port.take_handed_back()) {
    if (!wait_for(port, end_after(timeout))) {
      port.forget();
      return frames;
    }
    bool received = false;
    {
      const py::gil_scoped_release reading;
      received = port.receive();
    }
    if (received) {
      port.parse();
    } else {
      port.forget();
    }
  }
  if (port.failed()) {
    throw_failure(port);
  }
  for (const StoredFrame& frame : port.frames()) {
    frames.append(tuple_of(frame.frame()));
  }
  return frames;
}

/// The loop, with the scan of Python that it reads temperatures and layout from, and writes the newest scan to.
class PythonLoop {
public:
  PythonLoop(BoardDecoder& decoder, FramePort& port, LoopControl& control, ArrivalTime& arrival_time, py::object scan)
      : decoder_(decoder), loop_(decoder, port, control, arrival_time), scan_(std::move(scan)) {
    temperatures_ = py::cast<py::array_t<float, py::array::c_style>>(scan_.attr("temperatures"));
    context_.layout = py::cast<std::uint64_t>(scan_.attr("layout_id"));
    context_.temperatures = temperatures_.data();
    context_.sensors = static_cast<std::size_t>(temperatures_.size());
  }

  LoopEnd run(const py::capsule& sink, double timeout) {
    const auto* target = static_cast<const ScanSink*>(PyCapsule_GetPointer(sink.ptr(), kScanSinkName));
    if (target == nullptr) {
      throw py::error_already_set();
    }
    const std::int64_t end = end_after(timeout);
    const std::uint64_t before = loop_.taken();
    LoopEnd found = LoopEnd::kTimeout;
    {
      const py::gil_scoped_release running;
      found = loop_.run(*target, context_, end);
    }
    if (found == LoopEnd::kInterrupted) {
      check_signals();
    }
    if (found == LoopEnd::kScan || loop_.taken() != before) {
      ScanFields::set(scan_, decoder_.scan());
    }
    return found;
  }

  /// Go on to what the rest of a batch brings, as `advance` of a decoder does.
  py::object advance() {
    LoopEnd found = LoopEnd::kTimeout;
    if (!loop_.advance(found)) {
      return py::none();
    }
    if (found == LoopEnd::kMessage) {
      return message();
    }
    ScanFields::set(scan_, decoder_.scan());
    return py::bool_(true);
  }

  py::tuple message() const { return tuple_of(loop_.message()); }

  py::list take_frame_counts() {
    py::list counts;
    loop_.take_frame_counts([&counts](unsigned kind, std::size_t length, std::uint32_t number) {
      counts.append(py::make_tuple(kind, length, number));
    });
    return counts;
  }

  const ScanLoop& loop() const { return loop_; }

private:
  BoardDecoder& decoder_;
  ScanLoop loop_;
  py::object scan_;
  py::array_t<float, py::array::c_style> temperatures_;
  ScanContext context_;
};

void bind_ports(const py::module_& module) {
  py::class_<FramePort>(module, "FramePort", "Reads the frames that wait at a file descriptor.")
      .def("read", &read, py::arg("timeout"),
           "Return the frames that are waiting; when there is none, wait up to `timeout` [s] for the first.")
      .def_property_readonly("stamp", &FramePort::stamp, "Wall time of the newest frame's arrival [ns]; 0: unknown.");
  py::class_<LinePort, FramePort>(module, "LinePort", "The lines of an slcan adapter.")
      .def(py::init<int, LineReader&>(), py::arg("descriptor"), py::arg("reader"), py::keep_alive<1, 3>());
  py::class_<SocketPort, FramePort>(module, "SocketPort", "A SocketCAN socket.")
      .def(py::init<int>(), py::arg("descriptor"))
      .def_property_readonly("dropped", &SocketPort::dropped, "Frames that the kernel has dropped.");
  module.attr("READ_LIMIT") = SocketPort::kReadLimit;
  py::class_<ArrivalTime>(module, "ArrivalTime", "Maps the kernel's stamps to monotonic time.")
      .def(py::init<>())
      .def("of_newest", &ArrivalTime::of_newest, py::arg("stamp"), py::arg("now"), py::arg("wall_offset"));
  module.attr("OFFSET_TOLERANCE") = kOffsetTolerance;
}

}  // namespace

void bind_loop(const py::module_& module) {
  bind_ports(module);
  py::class_<LoopControl>(module, "LoopControl", "Calls a loop back; as a context manager, keeps it from decoding.")
      .def(py::init<>())
      .def("wake", &LoopControl::wake, py::call_guard<py::gil_scoped_release>(),
           "End the call that runs, or the next one; no scan is handed on before another call.")
      .def("__enter__", [](LoopControl& control) { acquire(control.mutex()); })
      .def("__exit__", [](LoopControl& control, const py::args& /*error*/) { control.mutex().unlock(); });
  py::enum_<LoopEnd>(module, "LoopEnd", "Why a call of a loop has ended.")
      .value("SCAN", LoopEnd::kScan)
      .value("MESSAGE", LoopEnd::kMessage)
      .value("LAST", LoopEnd::kLast)
      .value("HANDED", LoopEnd::kHanded)
      .value("WOKEN", LoopEnd::kWoken)
      .value("TIMEOUT", LoopEnd::kTimeout)
      .value("INTERRUPTED", LoopEnd::kInterrupted);
  py::class_<PythonLoop>(module, "ScanLoop", "Decodes what a port reads, and hands on the scans, in one call.")
      .def(py::init<BoardDecoder&, FramePort&, LoopControl&, ArrivalTime&, py::object>(), py::arg("decoder"),
           py::arg("port"), py::arg("control"), py::arg("arrival_time"), py::arg("scan"), py::keep_alive<1, 2>(),
           py::keep_alive<1, 3>(), py::keep_alive<1, 4>(), py::keep_alive<1, 5>())
      .def("run", &PythonLoop::run, py::arg("sink"), py::arg("timeout"),
           "Hand scans to a sink until something else is needed, or for `timeout` [s]; return why it has ended.")
      .def("advance", &PythonLoop::advance,
           "Go on in the rest of a batch: True for a scan, the frame of a message, None at the end.")
      .def_property_readonly("message", &PythonLoop::message, "Frame of the message that has ended `run`.")
      .def("take_frame_counts", &PythonLoop::take_frame_counts,
           "Return kind, length and number of the frames since the call before.")
      .def_property_readonly("pending", [](const PythonLoop& loop) { return loop.loop().pending(); })
      .def_property_readonly("arrival", [](const PythonLoop& loop) { return loop.loop().arrival(); })
      .def_property_readonly("wall_offset", [](const PythonLoop& loop) { return loop.loop().wall_offset(); })
      .def_property_readonly("taken", [](const PythonLoop& loop) { return loop.loop().taken(); });
}

}  // namespace posfet::protocol
