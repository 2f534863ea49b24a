// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
#include "posfet_core/protocol/frame_port.hpp"

#include <linux/sock_diag.h>
#include <linux/sockios.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <ctime>

#include "posfet_core/protocol/kernel_frame.hpp"

#ifndef SIOCGSTAMPNS
#define SIOCGSTAMPNS 0x8907
#endif

namespace posfet::protocol {

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

std::int64_t now_of(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return now.tv_sec * kSecond + now.tv_nsec;
}

}  // namespace

std::int64_t monotonic_now() { return now_of(CLOCK_MONOTONIC); }

std::int64_t wall_now() { return now_of(CLOCK_REALTIME); }

Waited wait_until(int descriptor, int wake, std::int64_t end) {
  std::array<pollfd, 2> watched{{{descriptor, POLLIN, 0}, {wake, POLLIN, 0}}};  // a negative one is ignored
  const std::int64_t left = std::max<std::int64_t>(end - monotonic_now(), 0);
  const timespec timeout{left / kSecond, left % kSecond};
  if (ppoll(watched.data(), watched.size(), &timeout, nullptr) < 0) {
    return Waited::kInterrupted;
  }
  if (watched[1].revents != 0) {
    return Waited::kWoken;
  }
  return watched[0].revents != 0 ? Waited::kReadable : Waited::kTimeout;
}

void FramePort::note(std::ptrdiff_t size) {
  if (size == 0) {
    ended_ = true;
  } else if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) {
    error_ = errno;
  }
}

void FramePort::clear_failure() {
  error_ = 0;
  ended_ = false;
}

LinePort::LinePort(int descriptor, LineReader& reader)
    : FramePort(descriptor, kReadSize / kShortestLine + 1), reader_(reader) {}

bool LinePort::receive() {
  clear_failure();
  const ssize_t size = read(descriptor(), bytes_.data(), bytes_.size());
  size_ = size > 0 ? static_cast<std::size_t>(size) : 0;
  if (size <= 0) {
    note(size);
  }
  return size_ > 0;
}

void LinePort::parse() {
  std::vector<StoredFrame>& frames = storage();
  frames.clear();
  reader_.split(bytes_.data(), size_, [&](const Line& line) {
    if (!parse_line(line, frames.emplace_back())) {
      frames.pop_back();
      reader_.count(line);
    }
  });
  size_ = 0;
}

bool SocketPort::receive() {
  clear_failure();
  std::vector<StoredFrame>& frames = storage();
  frames.clear();
  set_stamp(0);
  remarkable_ = false;
  std::array<std::uint8_t, kKernelFdFrame> bytes{};
  while (frames.size() < kReadLimit) {
    const ssize_t size = recv(descriptor(), bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (size <= 0) {
      note(size);
      break;
    }
    const auto frame = parse_kernel_frame(bytes.data(), static_cast<std::size_t>(size));
    if (!frame) {
      note(0);
      break;
    }
    StoredFrame& kept = frames.emplace_back();
    kept.identifier = frame->identifier;
    kept.kind = frame->kind;
    kept.length = frame->length;
    std::copy_n(frame->data, frame->length, kept.data.begin());
    remarkable_ = remarkable_ || (frame->kind & kError) != 0;
  }
  timespec stamp{};
  if (ioctl(descriptor(), SIOCGSTAMPNS, &stamp) == 0) {
    set_stamp(stamp.tv_sec * kSecond + stamp.tv_nsec);
  }
  std::array<std::uint32_t, SK_MEMINFO_VARS> memory{};
  socklen_t length = sizeof memory;
  if (getsockopt(descriptor(), SOL_SOCKET, SO_MEMINFO, memory.data(), &length) == 0 &&
      memory[SK_MEMINFO_DROPS] != dropped_) {
    dropped_ = memory[SK_MEMINFO_DROPS];
    remarkable_ = true;
  }
  return !frames.empty();
}

}  // namespace posfet::protocol
