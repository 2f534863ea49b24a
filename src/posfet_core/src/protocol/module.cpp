// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// The Python module posfet_core.protocol: from the bytes of a bus to complete scans.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "posfet_core/protocol/ascending_stamps.hpp"
#include "posfet_core/protocol/board_decoder.hpp"
#include "posfet_core/protocol/classic_scans.hpp"
#include "posfet_core/protocol/clock_sync.hpp"
#include "posfet_core/protocol/fd_scans.hpp"
#include "posfet_core/protocol/kernel_frame.hpp"
#include "posfet_core/protocol/slcan.hpp"
#include "posfet_core/protocol/tick_line.hpp"
#include "python_batch.hpp"
#include "python_frames.hpp"
#include "python_integers.hpp"
#include "python_loop.hpp"
#include "python_mapped.hpp"

namespace posfet::protocol {

namespace {

using Counts = py::array_t<std::uint16_t, py::array::c_style>;

const std::uint8_t* bytes_of(const py::bytes& data) {
  return reinterpret_cast<const std::uint8_t*>(PyBytes_AS_STRING(data.ptr()));
}

std::size_t size_of(const py::bytes& data) { return static_cast<std::size_t>(PyBytes_GET_SIZE(data.ptr())); }

py::bytes text_of(const Line& line) { return py::bytes(reinterpret_cast<const char*>(line.text), line.length); }

py::list lines_of(LineReader& reader, const py::bytes& data) {
  py::list lines;
  reader.split(bytes_of(data), size_of(data), [&lines](const Line& line) { lines.append(text_of(line)); });
  return lines;
}

py::list frames_of(LineReader& reader, const py::bytes& data) {
  py::list frames;
  reader.read(bytes_of(data), size_of(data), [&frames](const Frame& frame) { frames.append(tuple_of(frame)); });
  return frames;
}

/// The frame of a line, or None.
py::object frame_of_line(const py::bytes& line) {
  LineFrame frame;
  if (parse_line({bytes_of(line), size_of(line)}, frame)) {
    return tuple_of(frame.frame());
  }
  return py::none();
}

std::invalid_argument too_few(const py::bytes& data) {
  return std::invalid_argument("a frame of the kernel has at least 8 bytes, got " + std::to_string(size_of(data)));
}

py::tuple frame_of_kernel(const py::bytes& data) {
  const std::optional<Frame> frame = parse_kernel_frame(bytes_of(data), size_of(data));
  if (!frame) {
    throw too_few(data);
  }
  return tuple_of(*frame);
}

ScanFormat checked_format(bool fd, std::size_t taxels) {
  if (taxels < 1 || taxels > kMostTaxels) {
    throw std::invalid_argument("taxels must be in [1, " + std::to_string(kMostTaxels) + "], got " +
                                std::to_string(taxels));
  }
  return {fd, taxels};
}

void unpack(bool fd, const py::buffer& wire, Counts& out) {
  const ScanFormat format = checked_format(fd, static_cast<std::size_t>(out.size()));
  const py::buffer_info info = wire.request();
  if (info.itemsize != 1 || static_cast<std::size_t>(info.size) != format.blocks() * format.block_length()) {
    throw std::invalid_argument("wire must have the bytes of all blocks");
  }
  unpack_counts(format, static_cast<const std::uint8_t*>(info.ptr), out.mutable_data());
}

/// The counts of an assembler that belongs to `owner`: a view.
Counts counts_of(Assembler& assembler, const py::object& owner) {
  return Counts({static_cast<py::ssize_t>(assembler.counts().size())}, assembler.counts().data(), owner);
}

/// Go on to what the next of the batch's frames have brought.
///
/// Returns True when that is a scan, which is written to `scan`; the frame when it is a message; None at the end.
py::object advance(BoardDecoder& decoder, Batch& batch, const py::object& scan) {
  if (batch.ended) {
    return py::none();
  }
  if (decoder.release()) {
    ScanFields::set(scan, decoder.scan());
    return py::bool_(true);
  }
  while (PyObject* item = batch.next()) {
    const Found found = decoder.feed(frame_of(item));
    if (found == Found::kScan || (found == Found::kReleased && decoder.release())) {
      ScanFields::set(scan, decoder.scan());
      return py::bool_(true);
    }
    if (found != Found::kNothing && found != Found::kReleased) {
      return py::reinterpret_borrow<py::object>(item);
    }
  }
  batch.ended = true;
  decoder.end_batch();
  return py::none();
}

template <typename Class>
void bind_counters(py::class_<Class>& bound, std::initializer_list<std::pair<const char*, Counter Class::*>> counters) {
  py::tuple names(counters.size());
  std::size_t index = 0;
  for (const auto& [name, counter] : counters) {
    bound.def_readwrite(name, counter);
    names[index++] = name;
  }
  bound.attr("__slots__") = names;
}

void bind_statistics(const py::module_& module) {
  py::class_<ScanStatistics> statistics(module, "ScanStatistics", "Frames and scans that were lost or rejected.");
  statistics.def(py::init<>());
  bind_counters<ScanStatistics>(statistics, {{"malformed", &ScanStatistics::malformed},
                                             {"checksum", &ScanStatistics::checksum},
                                             {"duplicate", &ScanStatistics::duplicate},
                                             {"frozen_counter", &ScanStatistics::frozen_counter},
                                             {"implausible", &ScanStatistics::implausible},
                                             {"reordered", &ScanStatistics::reordered},
                                             {"late", &ScanStatistics::late},
                                             {"incomplete_scans", &ScanStatistics::incomplete_scans},
                                             {"lost_scans", &ScanStatistics::lost_scans},
                                             {"missing_frames", &ScanStatistics::missing_frames}});
  py::class_<Traffic> traffic(module, "Traffic", "Frames that carry no scan of the board, by cause.");
  traffic.def(py::init<>());
  bind_counters<Traffic>(traffic, {{"frames", &Traffic::frames},
                                   {"commands", &Traffic::commands},
                                   {"unrelated", &Traffic::unrelated},
                                   {"malformed", &Traffic::malformed},
                                   {"status_lost", &Traffic::status_lost},
                                   {"status_repeated", &Traffic::status_repeated}});
}

void bind_frames(py::module_& module) {
  py::class_<LineReader>(module, "LineReader", "Splits a stream of bytes into lines and parses them into frames.")
      .def(py::init<>())
      .def_readwrite("malformed", &LineReader::malformed)
      .def_readwrite("refusals", &LineReader::refusals)
      .def_readwrite("flags", &LineReader::flags)
      .def("clear", &LineReader::clear, "Discard an unfinished line.")
      .def("lines", &lines_of, py::arg("data"), "Return the lines that `data` completes, without their ends.")
      .def("frames", &frames_of, py::arg("data"), "Return the frames of the lines that `data` completes.");
  module.def("parse_line", &frame_of_line, py::arg("line"), "Return the frame of one line, or None.");
  module.def("parse_kernel_frame", &frame_of_kernel, py::arg("data"), "Return the frame in the bytes of one read.");
  module.def("unpack_counts", &unpack, py::arg("fd"), py::arg("wire"), py::arg("out"),
             "Write the counts in the data of all blocks to `out`.");
}

void bind_clocks(const py::module_& module) {
  const py::class_<SyncState> state_class(module, "SyncState", "What a ClockSync knows.");
  py::class_<ClockSync>(module, "ClockSync", "Maps device time to this machine's monotonic time.")
      .def(py::init<>())
      .def_property_readonly("offset", &ClockSync::offset)
      .def_property_readonly("known", &ClockSync::known)
      .def_property_readonly("last", &ClockSync::last)
      .def_property_readonly("drift", &ClockSync::drift)
      .def_property_readonly("lead", &ClockSync::lead)
      .def_property_readonly("uncertainty", &ClockSync::uncertainty)
      .def("error", &ClockSync::error, py::arg("late"), py::arg("early"), py::arg("delay"))
      .def("delay", &ClockSync::delay, py::arg("device_time"), py::arg("arrival"))
      .def("reset", &ClockSync::reset)
      .def("interrupt", &ClockSync::interrupt, py::arg("device_time"), py::arg("arrival"))
      .def("doubt", &ClockSync::doubt, py::arg("device_time"), py::arg("arrival"), py::arg("ahead") = 0.0)
      .def("widen", &ClockSync::widen, py::arg("ahead"), py::arg("arrival"))
      .def("save", [](const ClockSync& sync) { return SyncState(sync.save()); })
      .def("restore", &ClockSync::restore, py::arg("state"))
      .def("to_monotonic", &ClockSync::to_monotonic, py::arg("device_time"), py::arg("arrival"));
  py::class_<WallOffset>(module, "WallOffset", "Wall time less monotonic time, read with each batch of frames.")
      .def(py::init<>())
      .def_property_readonly("value", &WallOffset::value)
      .def(
          "read", [](WallOffset& wall, Wide offset) { wall.read(static_cast<std::int64_t>(offset)); },
          py::arg("offset"));
  py::class_<AscendingStamps>(module, "AscendingStamps", "Orders the times of acquisition of published scans.")
      .def(py::init<>())
      .def_property_readonly("excess", &AscendingStamps::excess)
      .def("stamp", &AscendingStamps::stamp, py::arg("time"), py::arg("device_time"), py::arg("arrival"));
  py::class_<TickLine>(module, "TickLine", "The ticks of a board's scan timer, on the board's clock.")
      .def(py::init<>())
      .def_property_readonly("period", &TickLine::period)
      .def_property_readonly("nominal", &TickLine::nominal)
      .def_property_readonly("lowered", &TickLine::lowered)
      .def_property_readonly("agreed", &TickLine::agreed)
      .def_property_readonly("certain", &TickLine::certain)
      .def("restart", &TickLine::restart, py::arg("period"))
      .def("question", &TickLine::question)
      .def("add", &TickLine::add, py::arg("sequence"), py::arg("time"), py::arg("estimated"))
      .def("time", &TickLine::time, py::arg("sequence"));
  py::class_<DeviceClock>(module, "DeviceClock", "Device time of a board, unwrapped.")
      .def_property_readonly("time", &DeviceClock::time)
      .def_property_readonly("repeated", &DeviceClock::repeated)
      .def_property_readonly("stalled", &DeviceClock::stalled)
      .def_property_readonly("frozen", &DeviceClock::frozen);
  module.attr("FROZEN_READINGS") = kFrozenReadings;
}

void bind_scans(const py::module_& module) {
  using py::return_value_policy;
  py::class_<ScanNumbering>(module, "ScanNumbering", "Owner of boot and sequence of a board's scans.")
      .def_property_readonly("boot", &ScanNumbering::boot)
      .def_property_readonly("sequence", &ScanNumbering::sequence)
      .def_property_readonly("restarted", &ScanNumbering::restarted)
      .def("open", &ScanNumbering::open)
      .def("forget_gap", &ScanNumbering::forget_gap);
  py::class_<Assembler>(module, "Assembler", "Collects the blocks of one scan at a time.")
      .def(
          py::init([](bool fd, std::size_t taxels) { return std::make_unique<Assembler>(checked_format(fd, taxels)); }),
          py::arg("fd"), py::arg("taxels"))
      .def_readonly("statistics", &Assembler::statistics)
      .def_property_readonly("blocks", &Assembler::blocks)
      .def_property_readonly("complete", &Assembler::complete)
      .def_property_readonly("counts",
                             [](const py::object& owner) { return counts_of(owner.cast<Assembler&>(), owner); });
  py::class_<FdScans>(module, "FdScans", "Assigns each FD block to its scan.")
      .def(py::init<Assembler&, ClockSync&>(), py::arg("assembler"), py::arg("sync"), py::keep_alive<1, 2>(),
           py::keep_alive<1, 3>())
      .def_property_readonly("clock", &FdScans::clock, return_value_policy::reference_internal)
      .def_property_readonly(
          "numbering", [](FdScans& scans) -> ScanNumbering& { return scans.numbering(); },
          return_value_policy::reference_internal)
      .def_property_readonly("sequence", &FdScans::sequence)
      .def_property_readonly("time", &FdScans::time)
      .def("announce", &FdScans::announce, py::arg("period"), py::arg("confirmed"))
      .def("start", &FdScans::start)
      .def(
          "feed",
          [](FdScans& scans, unsigned kind, const py::bytes& data, Wide arrival) {
            return scans.feed(frame_of(0, kind, data), arrival);
          },
          py::arg("kind"), py::arg("data"), py::arg("arrival"));
  py::class_<ClassicScans>(module, "ClassicScans", "Assigns each classic block to its scan.")
      .def(py::init<Assembler&, ClockSync&>(), py::arg("assembler"), py::arg("sync"), py::keep_alive<1, 2>(),
           py::keep_alive<1, 3>())
      .def_property_readonly("clock", &ClassicScans::clock, return_value_policy::reference_internal)
      .def_property_readonly(
          "numbering", [](ClassicScans& scans) -> ScanNumbering& { return scans.numbering(); },
          return_value_policy::reference_internal)
      .def_property_readonly("sequence", &ClassicScans::sequence)
      .def_property_readonly("time", &ClassicScans::time)
      .def_property_readonly("doubtful", &ClassicScans::doubtful)
      .def("announce", &ClassicScans::announce, py::arg("period"), py::arg("confirmed"))
      .def("start", &ClassicScans::start)
      .def(
          "feed_header",
          [](ClassicScans& scans, unsigned kind, const py::bytes& data, Wide arrival) {
            scans.feed_header(frame_of(0, kind, data), arrival);
          },
          py::arg("kind"), py::arg("data"), py::arg("arrival"))
      .def(
          "feed",
          [](ClassicScans& scans, std::size_t block, unsigned kind, const py::bytes& data, Wide arrival) {
            return scans.feed(block, frame_of(0, kind, data), arrival);
          },
          py::arg("block"), py::arg("kind"), py::arg("data"), py::arg("arrival"));
}

void bind_decoder(const py::module_& module) {
  py::class_<TransitTimes>(module, "TransitTimes", "Longest time that the frames of a scan occupy the bus [s].")
      .def(py::init<double, double>(), py::arg("switched"), py::arg("unswitched"))
      .def_readonly("switched", &TransitTimes::switched)
      .def_readonly("unswitched", &TransitTimes::unswitched);
  py::class_<TransitTime>(module, "TransitTime", "Which of the two transit times holds.")
      .def_readwrite("times", &TransitTime::times);
  const py::class_<Batch> batch_class(module, "Batch", "Frames of a batch, and which is next.");
  py::class_<BoardDecoder>(module, "BoardDecoder", "Decodes the frames of a bus and picks out those of one board.")
      .def(py::init([](bool fd, std::size_t taxels, std::uint32_t base) {
             return std::make_unique<BoardDecoder>(checked_format(fd, taxels), base);
           }),
           py::arg("fd"), py::arg("taxels"), py::arg("base"))
      .def_readwrite("receiving", &BoardDecoder::receiving)
      .def_readonly("transit_time", &BoardDecoder::transit_time)
      .def_readonly("traffic", &BoardDecoder::traffic)
      .def_property_readonly("assembler", &BoardDecoder::assembler, py::return_value_policy::reference_internal)
      .def_property_readonly("scans", &BoardDecoder::scans)
      .def_property_readonly("resets", &BoardDecoder::resets)
      .def_property_readonly("sequence", &BoardDecoder::sequence)
      .def_property_readonly("frames_lost", &BoardDecoder::frames_lost)
      .def_property_readonly("frozen_clock", &BoardDecoder::frozen_clock)
      .def_property_readonly("clock_uncertainty", &BoardDecoder::clock_uncertainty)
      .def_property_readonly("announced_period", &BoardDecoder::announced_period)
      .def_property_readonly("kept_period", &BoardDecoder::kept_period)
      .def("set_period", &BoardDecoder::set_period, py::arg("period"), py::arg("confirmed") = true)
      .def(
          "sent",
          [](BoardDecoder& decoder, const py::bytes& command) { decoder.sent(bytes_of(command), size_of(command)); },
          py::arg("command"))
      .def("start", &BoardDecoder::start)
      .def("doubt_sequence", &BoardDecoder::doubt_sequence)
      .def("forget_gap", &BoardDecoder::forget_gap)
      .def("note_overflow", &BoardDecoder::note_overflow)
      .def("forget_status", &BoardDecoder::forget_status)
      .def(
          "begin_batch",
          [](BoardDecoder& decoder, const py::object& frames, Wide arrival, Wide wall_offset) {
            Batch batch(frames);
            decoder.traffic.frames += batch.size();
            decoder.begin_batch(static_cast<std::int64_t>(arrival), static_cast<std::int64_t>(wall_offset));
            return batch;
          },
          py::arg("frames"), py::arg("arrival"), py::arg("wall_offset"))
      .def("advance", &advance, py::arg("batch"), py::arg("scan"));
  module.attr("COMMANDS_KEPT") = kCommandsKept;
}

}  // namespace

}  // namespace posfet::protocol

PYBIND11_MODULE(protocol, module) {
  module.doc() = "From the bytes of a bus to complete, numbered and stamped scans, compiled.";
  posfet::protocol::bind_statistics(module);
  posfet::protocol::bind_frames(module);
  posfet::protocol::bind_clocks(module);
  posfet::protocol::bind_scans(module);
  posfet::protocol::bind_decoder(module);
  posfet::protocol::bind_mapped(module);
  posfet::protocol::bind_loop(module);
}
