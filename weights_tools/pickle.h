#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/dtype.h"

namespace slide {

/// What a pickle of a PyTorch checkpoint can be made of. Objects are indices into Pickle::objects, so that
/// shared and even cyclic structures cost nothing to hold and nobody recurses to read them.
struct PickleObject {
  enum class Type {
    kNone,
    kBool,
    kInt,
    kFloat,
    kString,
    kTuple,
    kList,
    kDict,
    kGlobal,
    kStorage,
    kTensor,
    kOpaque
  };
  Type type = Type::kNone;
  std::int64_t number = 0;  ///< kBool, kInt; kStorage, kTensor: index into Pickle::storages, tensors
  double real = 0;          ///< kFloat
  std::string text;         ///< kString; kGlobal: "module name"
  /// kTuple, kList; kDict: key, value, key, value, ...; kOpaque: its class or what would have made it (a
  /// kGlobal), then the state it was given, if any.
  std::vector<std::size_t> items;
};

/// A storage that tensors are views of: its data lies elsewhere in the checkpoint, under `key`.
struct PickleStorage {
  std::string key;
  DType dtype{};
  std::uint64_t count = 0;  ///< elements of the whole storage
};

/// A strided view of a storage; all in elements.
struct PickleTensor {
  std::size_t storage = 0;
  std::uint64_t offset = 0;
  std::vector<std::uint64_t> sizes;
  std::vector<std::uint64_t> strides;
};

struct Pickle {
  std::vector<PickleObject> objects;
  std::vector<PickleStorage> storages;
  std::vector<PickleTensor> tensors;
  std::size_t root = 0;      ///< the object that the pickle is
  std::size_t consumed = 0;  ///< bytes read, STOP included
};

/// Why a pickle was refused, in one clause, and where. Callers add the file's name.
struct PickleError : std::runtime_error {
  PickleError(const std::string& problem, std::size_t offset, bool truncated = false)
      : std::runtime_error(problem), at(offset), cut_short(truncated) {}
  std::size_t at;  ///< the byte of the opcode
  bool cut_short;  ///< the bytes ended before STOP: with more of them it might go on
};

/// Reads one pickle at the start of `bytes` without ever running code: a white list of opcodes (what Python's
/// protocols 2 to 5 write for plain containers, numbers and texts), and of functions that are understood
/// (OrderedDict, set, torch.Size, those that rebuild tensors and parameters). What any other class or
/// function would make stays an opaque object: nothing is called, its state is kept as data. Everything else
/// is a PickleError naming it. At most 2 million objects, and at most five dimensions a tensor.
[[nodiscard]] Pickle read_pickle(std::span<const std::byte> bytes);

/// What an opaque object is of, for a message: "argparse.Namespace".
[[nodiscard]] std::string class_name(const Pickle& pickle, const PickleObject& opaque);

}  // namespace slide
