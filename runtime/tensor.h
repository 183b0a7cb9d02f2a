#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string_view>

#include "runtime/dtype.h"
#include "runtime/shape.h"

namespace slide {

/// A handle to a dense row-major array: element type, shape, and storage that is either owned (64-byte
/// aligned, shared between copies of the handle) or a view of memory that somebody else keeps. Copying a
/// Tensor copies the handle; clone() copies the data.
class Tensor {
 public:
  static constexpr std::size_t kAlignment = 64;
  /// A number of bytes rounded up to a multiple of kAlignment.
  [[nodiscard]] static constexpr std::size_t aligned(std::size_t bytes) noexcept {
    return (bytes + kAlignment - 1) / kAlignment * kAlignment;
  }

  /// An empty handle: no storage.
  Tensor() = default;
  /// Owned storage, not initialised. Throws Error(kOutOfMemory) naming the size if there is no memory.
  Tensor(DType type, const Shape& shape);

  /// A writable view of `data`, which must hold shape.count() elements and outlive the view.
  static Tensor view(DType type, const Shape& shape, void* data);
  /// A read-only view that keeps `owner` alive (a memory-mapped file, say).
  static Tensor read_only(DType type, const Shape& shape, const void* data,
                          std::shared_ptr<const void> owner);
  /// An owned tensor of zeros.
  static Tensor zeros(DType type, const Shape& shape);
  /// An owned tensor holding a copy of `values`. Throws Error(kInternal) unless there are shape.count() of
  /// them.
  template <typename T>
  static Tensor from(const Shape& shape, std::span<const T> values) {
    return copy_of(DTypeOf<T>::value, shape, std::as_bytes(values));
  }

  [[nodiscard]] bool empty() const noexcept { return data_ == nullptr; }
  [[nodiscard]] DType dtype() const noexcept { return type_; }
  [[nodiscard]] const Shape& shape() const noexcept { return shape_; }
  [[nodiscard]] std::int64_t count() const noexcept { return shape_.count(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return static_cast<std::size_t>(shape_.count()) * size_of(type_);
  }

  /// The elements. Throws Error(kInternal) if T is not the element type.
  template <typename T>
  [[nodiscard]] std::span<const T> data() const {
    require(DTypeOf<T>::value, false);
    return {static_cast<const T*>(static_cast<const void*>(data_)), static_cast<std::size_t>(count())};
  }
  /// The elements, writable. Throws Error(kInternal) if T is not the element type or the tensor is read-only.
  template <typename T>
  [[nodiscard]] std::span<T> mutable_data() {
    require(DTypeOf<T>::value, true);
    return {static_cast<T*>(static_cast<void*>(data_)), static_cast<std::size_t>(count())};
  }
  [[nodiscard]] std::span<const std::byte> raw() const noexcept { return {data_, bytes()}; }
  /// Throws Error(kInternal) if the tensor is read-only.
  [[nodiscard]] std::span<std::byte> mutable_raw();

  /// The same storage with another shape of as many elements.
  [[nodiscard]] Tensor reshaped(const Shape& shape) const;
  /// A copy with storage of its own.
  [[nodiscard]] Tensor clone() const;
  /// A copy converted to another element type (round to nearest even; floating types and integers to floating
  /// types, floating to floating). Throws Error(kInternal) for other conversions. Returns *this if the type
  /// is the same.
  [[nodiscard]] Tensor to(DType type) const;

 private:
  static Tensor copy_of(DType type, const Shape& shape, std::span<const std::byte> bytes);
  void require(DType type, bool writable) const;

  DType type_ = DType::kF32;
  Shape shape_{std::int64_t{0}};
  std::byte* data_ = nullptr;
  bool writable_ = false;
  std::shared_ptr<const void> owner_;
};

/// The largest magnitude among the elements of a floating tensor; NaN if any element is NaN. 0 for no
/// elements.
[[nodiscard]] double max_abs(const Tensor& t);

/// max|a - b| over all elements of two floating tensors of one shape; NaN counts as infinity unless both are
/// NaN. Throws Error(kInternal) if the shapes differ.
[[nodiscard]] double max_abs_difference(const Tensor& a, const Tensor& b);

}  // namespace slide
