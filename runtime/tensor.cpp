#include "runtime/tensor.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>

#include "runtime/error.h"

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace slide {
namespace {

Error internal(const std::string& problem) { return Error(ErrorKind::kInternal, problem); }

double element(const Tensor& t, std::size_t i) {
  const std::byte* raw = t.raw().data();
  const auto load = [&]<typename T>(T) {
    T value;
    std::memcpy(&value, raw + i * sizeof(T), sizeof(T));
    return value;
  };
  switch (t.dtype()) {
    case DType::kF64:
      return load(double{});
    case DType::kF32:
      return static_cast<double>(load(float{}));
    case DType::kF16:
      return static_cast<double>(float_from_half(load(std::uint16_t{})));
    case DType::kBF16:
      return static_cast<double>(float_from_bfloat16(load(std::uint16_t{})));
    case DType::kI64:
      return static_cast<double>(load(std::int64_t{}));
    case DType::kI32:
      return static_cast<double>(load(std::int32_t{}));
    case DType::kI16:
      return static_cast<double>(load(std::int16_t{}));
    case DType::kI8:
      return static_cast<double>(load(std::int8_t{}));
    case DType::kU8:
      return static_cast<double>(load(std::uint8_t{}));
    case DType::kBool:
      return load(std::uint8_t{}) != 0 ? 1.0 : 0.0;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

/// The conversions of large weights, as loops that compilers vectorise; files may hold them unaligned.
template <typename From, typename To>
void convert(std::span<const std::byte> from, std::byte* to) {
  for (std::size_t i = 0; i < from.size() / sizeof(From); ++i) {
    From value;
    std::memcpy(&value, from.data() + i * sizeof(From), sizeof(From));
    const To converted = static_cast<To>(value);
    std::memcpy(to + i * sizeof(To), &converted, sizeof(To));
  }
}

/// binary64 to bfloat16 or binary16 through binary32 would round twice; rounding to odd first makes it exact.
float to_float_round_odd(double value) {
  const float nearest = static_cast<float>(value);
  if (static_cast<double>(nearest) == value || !std::isfinite(nearest) || std::isnan(value)) return nearest;
  std::uint32_t bits;
  std::memcpy(&bits, &nearest, sizeof bits);
  if (std::fabs(static_cast<double>(nearest)) > std::fabs(value)) --bits;  // truncate towards zero
  bits |= 1u;
  float odd;
  std::memcpy(&odd, &bits, sizeof odd);
  return odd;
}

constexpr std::size_t kHugePage = std::size_t{2} << 20;

std::shared_ptr<void> from_heap(std::size_t size) {
  return {std::aligned_alloc(Tensor::kAlignment, size), [](void* p) { std::free(p); }};
}

/// Of kAlignment at least; null if there is none. A large block asks for huge pages: planes lie further apart
/// than a page, so that a kernel that walks through the channels would wait for address translations, and
/// each small page would be faulted in by itself. It is mapped, not taken from the heap, which would keep
/// what it was once given back.
std::shared_ptr<void> allocate(std::size_t size) {
#if defined(__linux__)
  if (size < 2 * kHugePage) return from_heap(size);
  if (size > std::numeric_limits<std::size_t>::max() - 2 * kHugePage) return nullptr;
  size = (size + kHugePage - 1) / kHugePage * kHugePage;
  void* mapped =
      ::mmap(nullptr, size + kHugePage, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (mapped == MAP_FAILED) return nullptr;
  auto* start = static_cast<std::byte*>(mapped);
  const std::size_t before = -reinterpret_cast<std::uintptr_t>(start) % kHugePage;
  if (before > 0) (void)::munmap(start, before);
  (void)::munmap(start + before + size, kHugePage - before);
  (void)::madvise(start + before, size, MADV_HUGEPAGE);  // a wish
  return {start + before, [size](void* p) { (void)::munmap(p, size); }};
#else
  return from_heap(size);
#endif
}

}  // namespace

Tensor::Tensor(DType type, const Shape& shape) : type_(type), shape_(shape), writable_(true) {
  const std::size_t size = aligned(std::max<std::size_t>(bytes(), 1));
  std::shared_ptr<void> memory = allocate(size);
  if (memory == nullptr)
    throw Error(ErrorKind::kOutOfMemory,
                "no memory for a tensor of shape " + shape.text() + ", " + std::to_string(size) + " bytes");
  data_ = static_cast<std::byte*>(memory.get());
  owner_ = std::move(memory);
}

Tensor Tensor::view(DType type, const Shape& shape, void* data) {
  Tensor t;
  t.type_ = type;
  t.shape_ = shape;
  t.data_ = static_cast<std::byte*>(data);
  t.writable_ = true;
  return t;
}

Tensor Tensor::read_only(DType type, const Shape& shape, const void* data,
                         std::shared_ptr<const void> owner) {
  Tensor t = view(type, shape, const_cast<void*>(data));
  t.writable_ = false;
  t.owner_ = std::move(owner);
  return t;
}

Tensor Tensor::zeros(DType type, const Shape& shape) {
  Tensor t(type, shape);
  std::memset(t.data_, 0, t.bytes());
  return t;
}

Tensor Tensor::copy_of(DType type, const Shape& shape, std::span<const std::byte> bytes) {
  Tensor t(type, shape);
  if (t.bytes() != bytes.size())
    throw internal("a tensor of shape " + shape.text() + " was given " + std::to_string(bytes.size()) +
                   " bytes");
  std::memcpy(t.data_, bytes.data(), bytes.size());
  return t;
}

std::span<std::byte> Tensor::mutable_raw() {
  require(type_, true);
  return {data_, bytes()};
}

void Tensor::require(DType type, bool writable) const {
  if (type != type_)
    throw internal("a tensor of " + std::string(name_of(type_)) + " was read as " +
                   std::string(name_of(type)));
  if (writable && !writable_)
    throw internal("a read-only tensor of shape " + shape_.text() + " was to be written");
}

Tensor Tensor::reshaped(const Shape& shape) const {
  if (shape.count() != count()) throw internal("cannot reshape " + shape_.text() + " to " + shape.text());
  Tensor t = *this;
  t.shape_ = shape;
  return t;
}

Tensor Tensor::clone() const { return copy_of(type_, shape_, raw()); }

Tensor Tensor::to(DType type) const {
  if (type == type_) return *this;
  Tensor t(type, shape_);
  const std::size_t n = static_cast<std::size_t>(count());
  std::byte* raw = t.data_;
  const auto is = [&](DType from, DType to) { return type_ == from && type == to; };
  if (is(DType::kF32, DType::kF64)) {
    convert<float, double>(this->raw(), raw);
    return t;
  }
  if (is(DType::kF64, DType::kF32)) {
    convert<double, float>(this->raw(), raw);
    return t;
  }
  const auto store = [&](std::size_t i, auto value) {
    std::memcpy(raw + i * sizeof value, &value, sizeof value);
  };
  for (std::size_t i = 0; i < n; ++i) {
    const double value = element(*this, i);
    switch (type) {
      case DType::kF64:
        store(i, value);
        break;
      case DType::kF32:
        store(i, static_cast<float>(value));
        break;
      case DType::kF16:
        store(i, half_from_float(to_float_round_odd(value)));
        break;
      case DType::kBF16:
        store(i, bfloat16_from_float(to_float_round_odd(value)));
        break;
      default:
        throw internal("no conversion from " + std::string(name_of(type_)) + " to " +
                       std::string(name_of(type)));
    }
  }
  return t;
}

double max_abs(const Tensor& t) {
  double largest = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(t.count()); ++i) {
    const double magnitude = std::fabs(element(t, i));
    if (std::isnan(magnitude)) return magnitude;
    largest = std::max(largest, magnitude);
  }
  return largest;
}

double max_abs_difference(const Tensor& a, const Tensor& b) {
  if (a.shape() != b.shape())
    throw internal("tensors of shapes " + a.shape().text() + " and " + b.shape().text() + " were compared");
  double largest = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(a.count()); ++i) {
    const double x = element(a, i);
    const double y = element(b, i);
    if (std::isnan(x) && std::isnan(y)) continue;
    if (x == y) continue;  // equal infinities too
    const double difference = std::fabs(x - y);
    if (std::isnan(difference)) return std::numeric_limits<double>::infinity();
    largest = std::max(largest, difference);
  }
  return largest;
}

}  // namespace slide
