#include "server/wire/wire_check.h"

#include <fmt/format.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>

#include <limits>
#include <utility>

#include "common/error.h"

namespace itn {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::io::CodedInputStream;
using google::protobuf::io::ZeroCopyInputStream;
using WireFormat = google::protobuf::internal::WireFormatLite;

constexpr uint64_t kElementsWithoutLimit = 16;

bool is_packable(const FieldDescriptor& field) {
  return field.is_repeated() && field.is_packable();
}

class WireChecker {
 public:
  WireChecker(CodedInputStream& bytes, std::string what, const ElementLimits& limits)
      : bytes_(bytes), what_(std::move(what)), limits_(limits) {}

  // Up to the limit that the stream has.
  void check_message(const Descriptor& type, const std::string& path) {
    Counts counts;
    while (bytes_.BytesUntilLimit() != 0) {
      const uint32_t tag = bytes_.ReadTag();
      if (tag == 0) throw malformed();
      check_field(type, tag, path, counts);
    }
  }

 private:
  using Counts = std::unordered_map<int, uint64_t>;

  Error malformed() const { return invalid_input(what_); }

  void check_field(const Descriptor& type, uint32_t tag, const std::string& path, Counts& counts) {
    const int number = WireFormat::GetTagFieldNumber(tag);
    const FieldDescriptor* field = type.FindFieldByNumber(number);
    if (field == nullptr) {
      throw invalid_input(fmt::format("{} has a field with the unknown number {}", path, number));
    }
    const auto wire_type = WireFormat::GetTagWireType(tag);
    const auto own_type =
        WireFormat::WireTypeForFieldType(static_cast<WireFormat::FieldType>(field->type()));
    if (wire_type == own_type && wire_type != WireFormat::WIRETYPE_LENGTH_DELIMITED) {
      if (!WireFormat::SkipField(&bytes_, tag)) throw malformed();
      return count(*field, 1, path, counts);
    }
    const bool packed = is_packable(*field);
    if (wire_type != WireFormat::WIRETYPE_LENGTH_DELIMITED || (own_type != wire_type && !packed)) {
      throw malformed();
    }
    uint32_t length = 0;
    if (!bytes_.ReadVarint32(&length) || length > std::numeric_limits<int>::max() ||
        static_cast<int>(length) > bytes_.BytesUntilLimit()) {
      throw malformed();
    }
    if (packed) return check_packed(*field, own_type, static_cast<int>(length), path, counts);
    count(*field, 1, path, counts);
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) {
      if (!bytes_.Skip(static_cast<int>(length))) throw malformed();
      return;
    }
    const auto outer = bytes_.PushLimit(static_cast<int>(length));
    check_message(*field->message_type(), path + "." + field->name());
    bytes_.PopLimit(outer);
  }

  void check_packed(const FieldDescriptor& field, WireFormat::WireType element, int length,
                    const std::string& path, Counts& counts) {
    const auto outer = bytes_.PushLimit(length);
    while (bytes_.BytesUntilLimit() > 0) {
      uint64_t varint = 0;
      const bool read = element == WireFormat::WIRETYPE_FIXED32   ? bytes_.Skip(4)
                        : element == WireFormat::WIRETYPE_FIXED64 ? bytes_.Skip(8)
                                                                  : bytes_.ReadVarint64(&varint);
      if (!read) throw malformed();
      count(field, 1, path, counts);
    }
    bytes_.PopLimit(outer);
  }

  void count(const FieldDescriptor& field, uint64_t elements, const std::string& path,
             Counts& counts) const {
    if (!field.is_repeated()) {
      // What is merged into one message could have any number of elements in all.
      if (field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE &&
          (counts[field.number()] += elements) > 1) {
        throw invalid_input(fmt::format("{}.{} is given more than once", path, field.name()));
      }
      return;
    }
    const auto found = limits_.find(field.full_name());
    const uint64_t most = found == limits_.end() ? kElementsWithoutLimit : found->second;
    if ((counts[field.number()] += elements) > most) {
      throw invalid_input(fmt::format("{}.{} has more than {} elements", path, field.name(), most));
    }
  }

  CodedInputStream& bytes_;
  const std::string what_;
  const ElementLimits& limits_;
};

std::string not_serialized(const std::string& path, const Descriptor& type) {
  return fmt::format("{}: these bytes are not a serialized {}", path, type.full_name());
}

void parse(ZeroCopyInputStream& bytes, const std::string& path, Message& message) {
  if (!message.ParseFromZeroCopyStream(&bytes)) {
    throw invalid_input(not_serialized(path, *message.GetDescriptor()));
  }
}

}  // namespace

void check_wire(ZeroCopyInputStream& bytes, uint64_t size, const Descriptor& type,
                const std::string& path, const ElementLimits& limits) {
  if (size > static_cast<uint64_t>(std::numeric_limits<int>::max())) {
    throw Error(ErrorKind::kLimit, path + " is larger than 2 GiB");
  }
  CodedInputStream coded(&bytes);
  coded.SetTotalBytesLimit(std::numeric_limits<int>::max());
  coded.PushLimit(static_cast<int>(size));
  WireChecker(coded, not_serialized(path, type), limits).check_message(type, path);
}

void parse_checked(const OpenStream& open, uint64_t size, const std::string& path,
                   const ElementLimits& limits, Message& message) {
  const Descriptor& type = *message.GetDescriptor();
  const auto opened = [&] {
    std::unique_ptr<ZeroCopyInputStream> stream = open();
    if (!stream) throw invalid_input(not_serialized(path, type));
    return stream;
  };
  check_wire(*opened(), size, type, path, limits);
  parse(*opened(), path, message);
}

void parse_checked(const std::string& bytes, const std::string& path, const ElementLimits& limits,
                   Message& message) {
  using google::protobuf::io::ArrayInputStream;
  if (bytes.size() > static_cast<size_t>(std::numeric_limits<int>::max())) {
    throw Error(ErrorKind::kLimit, path + " is larger than 2 GiB");
  }
  const int size = static_cast<int>(bytes.size());
  parse_checked([&] { return std::make_unique<ArrayInputStream>(bytes.data(), size); },
                bytes.size(), path, limits, message);
}

}  // namespace itn
