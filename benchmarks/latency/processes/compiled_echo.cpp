// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Lower bound given by machine and middleware, in C++: what `echo.py` does, without the interpreter. A library, as
// those of the ROS 2 wheels need the process of an interpreter; `compiled_echo.py` builds it and calls it.

#include <dlfcn.h>
#include <poll.h>
#include <rcl/error_handling.h>
#include <rcl/rcl.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <exception>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace {

constexpr std::size_t kSequence = 5;  // position of the low 16 bits of the sequence in the line of a CAN FD frame
constexpr int kWait = 100;            // [ms]
constexpr std::size_t kReadSize = 1 << 16;
constexpr std::size_t kDepth = 10;

volatile std::sig_atomic_t stopped = 0;

void check(rcl_ret_t result, const char* what) {
  if (result != RCL_RET_OK) {
    throw std::runtime_error(std::string(what) + ": " + rcl_get_error_string().str);
  }
}

std::int64_t now() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// Return the low 16 bits of the sequence in a line, which has them as two bytes of hexadecimal digits, the low one
/// first.
std::uint16_t sequence_in(std::string_view line) {
  const auto byte = [&](std::size_t at) {
    return static_cast<std::uint16_t>(std::stoul(std::string(line.substr(at, 2)), nullptr, 16));
  };
  return static_cast<std::uint16_t>(byte(kSequence) | (byte(kSequence + 2) << 8));
}

/// Sequences and the times of their messages [ns].
struct Times {
  std::vector<std::int64_t> sequences;
  std::vector<std::int64_t> times;

  void write(const char* path) const {
    std::string head = "{'descr': '<i8', 'fortran_order': False, 'shape': (2, " + std::to_string(times.size()) + "), }";
    head.resize((head.size() + 1 + 10 + 63) / 64 * 64 - 11, ' ');
    head += '\n';
    const auto size = static_cast<std::uint16_t>(head.size());
    std::ofstream stream(path, std::ios::binary);
    stream.write("\x93NUMPY\x01\x00", 8);
    stream.write(reinterpret_cast<const char*>(&size), sizeof size);
    stream << head;
    for (const auto* rows : {&sequences, &times}) {
      stream.write(reinterpret_cast<const char*>(rows->data()), static_cast<std::streamsize>(rows->size() * 8));
    }
  }
};

/// Publish a message for each line until stopped.
void echo(int terminal, rcl_publisher_t& publisher, rcl_serialized_message_t& message, std::size_t position,
          Times& times) {
  std::vector<char> data(kReadSize);
  std::string rest;
  pollfd waiting{terminal, POLLIN, 0};
  while (stopped == 0) {
    if (::poll(&waiting, 1, kWait) <= 0) {
      continue;
    }
    const ssize_t size = ::read(terminal, data.data(), data.size());
    if (size <= 0) {
      return;
    }
    rest.append(data.data(), static_cast<std::size_t>(size));
    std::size_t begin = 0;
    for (std::size_t end = rest.find('\r'); end != std::string::npos; end = rest.find('\r', begin)) {
      const std::string_view line = std::string_view(rest).substr(begin, end - begin);
      begin = end + 1;
      if (line.empty() || line[0] != 'b') {
        continue;  // a status frame
      }
      const std::uint64_t sequence = sequence_in(line);
      std::memcpy(message.buffer + position, &sequence, sizeof sequence);
      times.sequences.push_back(static_cast<std::int64_t>(sequence));
      times.times.push_back(now());
      check(rcl_publish_serialized_message(&publisher, &message, nullptr), "publish");
    }
    rest.erase(0, begin);
  }
}

/// Publish on /tactile/contacts until stopped.
void serve(int terminal, std::vector<std::uint8_t>& bytes, std::size_t position, const char* types, Times& times) {
  void* library = ::dlopen(types, RTLD_NOW);
  using TypeSupport = const rosidl_message_type_support_t* (*)();
  const auto type_support = reinterpret_cast<TypeSupport>(
      library == nullptr ? nullptr
                         : ::dlsym(library,
                                   "rosidl_typesupport_c__get_message_type_support_handle__"
                                   "posfet_msgs__msg__TactileContacts"));
  if (type_support == nullptr) {
    throw std::runtime_error(::dlerror());
  }

  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  check(rcl_init_options_init(&options, rcl_get_default_allocator()), "init options");
  rcl_context_t context = rcl_get_zero_initialized_context();
  check(rcl_init(0, nullptr, &options, &context), "init");
  rcl_node_t node = rcl_get_zero_initialized_node();
  const rcl_node_options_t node_options = rcl_node_get_default_options();
  check(rcl_node_init(&node, "echo", "/tactile", &context, &node_options), "node");
  rcl_publisher_t publisher = rcl_get_zero_initialized_publisher();
  rcl_publisher_options_t publisher_options = rcl_publisher_get_default_options();
  publisher_options.qos.depth = kDepth;
  check(rcl_publisher_init(&publisher, &node, type_support(), "contacts", &publisher_options), "publisher");
  std::cout << "ready" << std::endl;

  rcl_serialized_message_t message{bytes.data(), bytes.size(), bytes.size(), rcutils_get_default_allocator()};
  echo(terminal, publisher, message, position, times);

  check(rcl_publisher_fini(&publisher, &node), "publisher");
  check(rcl_node_fini(&node), "node");
  check(rcl_shutdown(&context), "shutdown");
  check(rcl_context_fini(&context), "context");
  check(rcl_init_options_fini(&options), "init options");
}

}  // namespace

/// Publish a message for each line of a CAN FD frame that is read, until SIGINT or SIGTERM; return 0, or 1 with a line
/// on stderr.
///
/// terminal: descriptor that is read. message, size: serialised message. position: where it has the 8 bytes of the
/// sequence. types: library with the C type supports of posfet_msgs. out: file that receives sequences and times of
/// publishing [ns], shape [2, n], as NumPy reads it.
extern "C" int compiled_echo(int terminal, const std::uint8_t* message, std::size_t size, std::size_t position,
                             const char* types, const char* out) {
  for (const int number : {SIGINT, SIGTERM}) {
    std::signal(number, [](int) { stopped = 1; });
  }
  Times times;
  try {
    std::vector<std::uint8_t> bytes(message, message + size);
    serve(terminal, bytes, position, types, times);
  } catch (const std::exception& error) {
    std::cerr << "compiled_echo: " << error.what() << '\n';
    return 1;
  }
  times.write(out);
  return 0;
}
