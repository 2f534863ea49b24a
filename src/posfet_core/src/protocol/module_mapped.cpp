// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// The decoder for boards with their own protocol, for Python.

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <memory>
#include <stdexcept>

#include "posfet_core/protocol/mapped_decoder.hpp"
#include "python_batch.hpp"
#include "python_frames.hpp"
#include "python_integers.hpp"
#include "python_mapped.hpp"

namespace posfet::protocol {

namespace {

using Table = py::array_t<std::uint16_t, py::array::c_style | py::array::forcecast>;

/// An array of Python on values that belong to `owner`.
template <typename Values>
py::array view_of(Values& values, const py::object& owner) {
  return py::array_t<typename Values::value_type>({static_cast<py::ssize_t>(values.size())}, values.data(), owner);
}

std::unique_ptr<MappedDecoder> make_decoder(const MappedTables& tables) {
  if (!tables.consistent()) {
    throw std::invalid_argument("the tables do not fit together");
  }
  return std::make_unique<MappedDecoder>(tables);
}

Batch begin_batch(MappedDecoder& decoder, const py::object& frames, Wide arrival, Wide wall_offset) {
  Batch batch(frames);
  std::size_t of_board = 0;
  if (decoder.counts_frames()) {
    Batch counted(frames);
    while (PyObject* item = counted.next()) {
      of_board += decoder.is_of_board(frame_of(item)) ? 1U : 0U;
    }
  }
  batch.ended = !decoder.begin_batch(batch.size(), of_board, arrival, static_cast<std::int64_t>(wall_offset));
  return batch;
}

/// Go on to the next scan that the batch's frames complete, and write it to `scan`; return False at the end.
bool advance_mapped(MappedDecoder& decoder, Batch& batch, const py::object& scan) {
  while (!batch.ended) {
    PyObject* item = batch.next();
    if (item == nullptr) {
      batch.ended = true;
    } else if (decoder.feed(frame_of(item))) {
      ScanFields::set(scan, decoder.scan());
      return true;
    }
  }
  return false;
}

void bind_tables(const py::module_& module) {
  py::class_<BitField>(module, "BitField", "Place of a signal in a frame.")
      .def(py::init([](std::size_t first, std::size_t end, bool big, unsigned shift, unsigned length) {
             return BitField{first, end, big, shift, length};
           }),
           py::arg("first"), py::arg("end"), py::arg("big"), py::arg("shift"), py::arg("length"))
      .def(
          "read",
          [](const BitField& field, const py::bytes& data) {
            const Frame frame = frame_of(0, kClassic, data);
            if (!field.fits(frame.length)) {
              throw std::invalid_argument("the data do not hold the field");
            }
            return field.read(frame.data);
          },
          py::arg("data"), "Return the unsigned bits in the data of a frame.");
  py::class_<SignalReading>(module, "SignalReading", "A signal besides the scan.")
      .def(py::init([](const BitField& field, int temperature, unsigned flag, std::uint64_t sign, double scale,
                       double offset, double low, double high) {
             return SignalReading{field, temperature, flag, sign, scale, offset, low, high};
           }),
           py::arg("field"), py::arg("temperature"), py::arg("flag"), py::arg("sign"), py::arg("scale"),
           py::arg("offset"), py::arg("low"), py::arg("high"));
  py::class_<MappedPart>(module, "MappedPart", "What the frames with one identifier and multiplexer value hold.")
      .def(py::init([](int block, std::optional<BitField> sequence, std::optional<BitField> time,
                       std::vector<SignalReading> readings) {
             return MappedPart{block, sequence, time, std::move(readings)};
           }),
           py::arg("block"), py::arg("sequence"), py::arg("time"), py::arg("readings"));
  py::class_<MappedMessage>(module, "MappedMessage", "A message that the mapping uses.")
      .def(py::init([](std::size_t length, std::size_t sent_length, std::optional<BitField> select,
                       std::vector<std::pair<std::uint64_t, int>> parts) {
             std::sort(parts.begin(), parts.end());
             return MappedMessage{length, sent_length, select, std::move(parts)};
           }),
           py::arg("length"), py::arg("sent_length"), py::arg("select"), py::arg("parts"));
  py::class_<CountPlace>(module, "CountPlace", "Place of a taxel's count.")
      .def(
          py::init([](std::size_t at, const BitField& field, std::size_t base) { return CountPlace{at, field, base}; }),
          py::arg("at"), py::arg("field"), py::arg("base"));
}

void set_kinds(MappedTables& tables, const std::vector<std::tuple<std::uint32_t, unsigned, std::size_t>>& kinds) {
  for (const auto& [identifier, kind, message] : kinds) {
    tables.kinds.emplace_back(key_of(identifier, kind), message);
  }
  std::sort(tables.kinds.begin(), tables.kinds.end());
}

}  // namespace

void bind_mapped(const py::module_& module) {
  bind_tables(module);
  py::class_<MappedTables>(module, "MappedTables", "All that is needed to decode the frames of a board.")
      .def(py::init<>())
      .def_readwrite("period", &MappedTables::period)
      .def_readwrite("slots", &MappedTables::slots)
      .def_readwrite("sequence_bits", &MappedTables::sequence_bits)
      .def_readwrite("sequenced", &MappedTables::sequenced)
      .def_readwrite("time_bits", &MappedTables::time_bits)
      .def_readwrite("timed", &MappedTables::timed)
      .def_readwrite("tick", &MappedTables::tick)
      .def_readwrite("ticks_back", &MappedTables::ticks_back)
      .def_readwrite("parts", &MappedTables::parts)
      .def_readwrite("messages", &MappedTables::messages)
      .def_readwrite("identifiers", &MappedTables::identifiers)
      .def_readwrite("counts", &MappedTables::counts)
      .def("set_kinds", &set_kinds, py::arg("kinds"), "Set the message of each identifier and kind of a frame.")
      .def(
          "set_table",
          [](MappedTables& tables, const Table& table) {
            tables.table.assign(table.data(), table.data() + table.size());
          },
          py::arg("table"), "Set the counts by raw value, of all scalings.");
  py::class_<MappedDecoder>(module, "MappedDecoder", "Decodes the frames of a bus that tables name.")
      .def(py::init(&make_decoder), py::arg("tables"))
      .def_readwrite("receiving", &MappedDecoder::receiving)
      .def_readonly("transit_time", &MappedDecoder::transit_time)
      .def_readonly("traffic", &MappedDecoder::traffic)
      .def_property_readonly(
          "statistics", [](MappedDecoder& decoder) -> ScanStatistics& { return decoder.assembler().statistics; },
          py::return_value_policy::reference_internal)
      .def_property_readonly(
          "counts", [](const py::object& owner) { return view_of(owner.cast<MappedDecoder&>().counts(), owner); })
      .def_property_readonly(
          "temperatures",
          [](const py::object& owner) { return view_of(owner.cast<MappedDecoder&>().temperatures(), owner); })
      .def_property_readonly("scans", &MappedDecoder::scans)
      .def_property_readonly("resets", &MappedDecoder::resets)
      .def_property_readonly("flags", &MappedDecoder::flags)
      .def_property_readonly("sequence", [](const MappedDecoder& decoder) { return decoder.numbering().sequence(); })
      .def_property_readonly("frozen_clock",
                             [](const MappedDecoder& decoder) { return decoder.numbering().frozen_clock(); })
      .def_property_readonly("frames_lost", &MappedDecoder::frames_lost)
      .def_property_readonly("clock_uncertainty", &MappedDecoder::clock_uncertainty)
      .def("start", &MappedDecoder::start)
      .def("note_overflow", &MappedDecoder::note_overflow)
      .def("begin_batch", &begin_batch, py::arg("frames"), py::arg("arrival"), py::arg("wall_offset"))
      .def("advance", &advance_mapped, py::arg("batch"), py::arg("scan"));
}

}  // namespace posfet::protocol
