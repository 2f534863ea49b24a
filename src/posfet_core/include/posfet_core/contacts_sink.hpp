// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// Takes scans in the thread that decodes them, and publishes their contacts, without an interpreter.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>

#include "posfet_core/contacts_cdr.hpp"
#include "posfet_core/reconstructor.hpp"
#include "posfet_core/scan_sink.hpp"

namespace posfet {

/// A serialised message as rcl takes it: rcutils_uint8_array_t (rcutils/types/uint8_array.h), whose allocator is unused
/// when a message is published.
struct SerializedMessage {
  const std::uint8_t* buffer = nullptr;
  std::size_t length = 0;
  std::size_t capacity = 0;
  void* allocator[5] = {};  // NOLINT(modernize-avoid-c-arrays): as in C
};

/// rcl_publish_serialized_message and rcutils_reset_error, as found in the process, and the publisher
/// (rcl_publisher_t).
struct Publishing {
  int (*publish)(const void* publisher, const SerializedMessage* message, void* allocation) = nullptr;
  void (*reset_error)() = nullptr;
  const void* publisher = nullptr;  ///< Null: nobody subscribes.
};

/// Takes the scans of a reconstructor. What it refers to belongs to the caller.
class ContactsSink {
public:
  /// `mutex` is held while a scan is processed.
  ContactsSink(Reconstructor& reconstructor, ContactsWriter& writer, std::mutex& mutex)
      : reconstructor_(reconstructor), writer_(writer), mutex_(mutex) {}

  ContactsSink(const ContactsSink&) = delete;
  ContactsSink& operator=(const ContactsSink&) = delete;

  /// Publish the contacts of the next scans this way; not while scans are taken.
  void set_publishing(const Publishing& publishing) { publishing_ = publishing; }

  /// Refuse all further scans; with the mutex held.
  void close() { closed_ = true; }

  /// Process a scan and publish its contacts, then close a block that is due. It is the last one when they could not be
  /// published.
  Taken take(const Scan& scan);

  /// Whether the contacts of the newest scan could not be published; forgotten by the question.
  bool take_failure();

  const ScanSink& sink() const { return sink_; }

private:
  bool publish();

  Reconstructor& reconstructor_;
  ContactsWriter& writer_;
  std::mutex& mutex_;
  Publishing publishing_;
  bool closed_ = false;
  bool failed_ = false;
  ScanSink sink_{this, [](void* self, const Scan& scan) { return static_cast<ContactsSink*>(self)->take(scan); }};
};

}  // namespace posfet
