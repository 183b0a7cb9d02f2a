// The pickle machine (Python's pickletools.py documents every opcode): a stack of objects, a stack of marks,
// a memo. Each opcode makes at most one object and takes at least one byte, and objects refer to each other
// by index, so time and memory stay in proportion to the bytes read, whatever they say.
#include "weights_tools/pickle.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <map>
#include <optional>
#include <unordered_map>

#include "runtime/safetensors_header.h"
#include "runtime/shape.h"

namespace slide {
namespace {

using Type = PickleObject::Type;

constexpr std::size_t kMaxObjects = 2'000'000;
constexpr std::size_t kMaxArguments = 8;
constexpr std::size_t kMaxKey = 256;
constexpr std::size_t kMaxGlobal = 512;

struct StorageClass {
  std::string_view name;
  DType dtype;
};
constexpr std::array<StorageClass, 10> kStorageClasses = {{{"torch DoubleStorage", DType::kF64},
                                                           {"torch FloatStorage", DType::kF32},
                                                           {"torch HalfStorage", DType::kF16},
                                                           {"torch BFloat16Storage", DType::kBF16},
                                                           {"torch LongStorage", DType::kI64},
                                                           {"torch IntStorage", DType::kI32},
                                                           {"torch ShortStorage", DType::kI16},
                                                           {"torch CharStorage", DType::kI8},
                                                           {"torch ByteStorage", DType::kU8},
                                                           {"torch BoolStorage", DType::kBool}}};

constexpr std::array<std::string_view, 8> kFunctions = {"collections OrderedDict",
                                                        "__builtin__ set",
                                                        "builtins set",
                                                        "torch Size",
                                                        "torch._utils _rebuild_tensor",
                                                        "torch._utils _rebuild_tensor_v2",
                                                        "torch._utils _rebuild_parameter",
                                                        "torch._utils _rebuild_parameter_with_state"};

std::optional<DType> storage_dtype(std::string_view name) {
  const auto* found = std::ranges::find(kStorageClasses, name, &StorageClass::name);
  if (found == kStorageClasses.end()) return std::nullopt;
  return found->dtype;
}

/// A text of the file's for a message.
std::string printable(std::string text) {
  if (find_invalid_utf8(text)) return "(not a text)";
  if (text.size() > 80) text = text.substr(0, 80) + "...";
  for (char& c : text)
    if (has_control_character({&c, 1})) c = '?';
  return text;
}

class Machine {
 public:
  explicit Machine(std::span<const std::byte> bytes) : bytes_(bytes) {}

  Pickle run() {
    do {
      opcode_at_ = at_;
    } while (step(number<std::uint8_t>()));
    pickle_.consumed = at_;
    return std::move(pickle_);
  }

 private:
  // One line an opcode, in the order of pickletools.
  bool step(std::uint8_t opcode) {
    switch (opcode) {
      case 0x80:
        check_protocol(number<std::uint8_t>());
        break;  // PROTO
      case 0x95:
        static_cast<void>(number<std::uint64_t>());
        break;  // FRAME
      case 'B':
        push_text(number<std::uint32_t>());
        break;  // BINBYTES
      case 'C':
        push_text(number<std::uint8_t>());
        break;  // SHORT_BINBYTES
      case 'J':
        push_int(number<std::int32_t>());
        break;  // BININT
      case 'K':
        push_int(number<std::uint8_t>());
        break;  // BININT1
      case 'M':
        push_int(number<std::uint16_t>());
        break;  // BININT2
      case 0x8a:
        push_int(long1());
        break;  // LONG1
      case 'T':
        push_text(number<std::uint32_t>());
        break;  // BINSTRING
      case 'U':
        push_text(number<std::uint8_t>());
        break;  // SHORT_BINSTRING
      case 'X':
        push_text(number<std::uint32_t>());
        break;  // BINUNICODE
      case 0x8c:
        push_text(number<std::uint8_t>());
        break;  // SHORT_BINUNICODE
      case 0x8d:
        push_text(number<std::uint64_t>());
        break;  // BINUNICODE8
      case 'N':
        push(Type::kNone);
        break;  // NONE
      case 0x88:
        push_bool(true);
        break;  // NEWTRUE
      case 0x89:
        push_bool(false);
        break;  // NEWFALSE
      case 'G':
        push_real();
        break;  // BINFLOAT
      case ']':
        push(Type::kList);
        break;  // EMPTY_LIST
      case 'a':
        append(pop_last(1));
        break;  // APPEND
      case 'e':
        append(pop_to_mark());
        break;  // APPENDS
      case ')':
        push(Type::kTuple);
        break;  // EMPTY_TUPLE
      case 't':
        push_tuple(pop_to_mark());
        break;  // TUPLE
      case 0x85:
        push_tuple(pop_last(1));
        break;  // TUPLE1
      case 0x86:
        push_tuple(pop_last(2));
        break;  // TUPLE2
      case 0x87:
        push_tuple(pop_last(3));
        break;  // TUPLE3
      case '}':
        push(Type::kDict);
        break;  // EMPTY_DICT
      case 's':
        set_items(pop_last(2));
        break;  // SETITEM
      case 'u':
        set_items(pop_to_mark());
        break;  // SETITEMS
      case '(':
        marks_.push_back(stack_.size());
        break;  // MARK
      case 'h':
        get(number<std::uint8_t>());
        break;  // BINGET
      case 'j':
        get(number<std::uint32_t>());
        break;  // LONG_BINGET
      case 'q':
        put(number<std::uint8_t>());
        break;  // BINPUT
      case 'r':
        put(number<std::uint32_t>());
        break;  // LONG_BINPUT
      case 0x94:
        put(static_cast<std::uint32_t>(memo_.size()));
        break;  // MEMOIZE
      case 'c':
        global_of_lines();
        break;  // GLOBAL
      case 0x93:
        stack_global();
        break;  // STACK_GLOBAL
      case 'R':
        reduce();
        break;  // REDUCE
      case 0x81:
        push_opaque(pop_last(2)[0]);
        break;  // NEWOBJ
      case 0x92:
        push_opaque(pop_last(3)[0]);
        break;  // NEWOBJ_EX
      case 0x8f:
        push(Type::kList);
        break;  // EMPTY_SET
      case 0x90:
        append(pop_to_mark());
        break;  // ADDITEMS
      case 'b':
        build();
        break;  // BUILD
      case 'Q':
        persistent_id();
        break;  // BINPERSID
      case '.':
        stop();
        return false;  // STOP
      default:
        fail("the opcode " + hexadecimal(opcode) + " is not allowed");
    }
    return true;
  }

  [[noreturn]] void fail(const std::string& problem) const { throw PickleError(problem, opcode_at_); }

  static std::string hexadecimal(std::uint8_t byte) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    return std::string("0x") + kDigits[byte >> 4] + kDigits[byte & 15u];
  }

  // --- bytes

  std::span<const std::byte> take(std::uint64_t count) {
    if (count > bytes_.size() - at_) throw PickleError("the pickle is cut short", opcode_at_, true);
    const std::span<const std::byte> taken = bytes_.subspan(at_, static_cast<std::size_t>(count));
    at_ += taken.size();
    return taken;
  }
  template <typename T>
  T number() {
    T value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  std::string text(std::uint64_t size) {
    const std::span<const std::byte> taken = take(size);
    return {reinterpret_cast<const char*>(taken.data()), taken.size()};
  }
  std::string line() {
    const std::span<const std::byte> rest = bytes_.subspan(at_);
    const auto end = std::ranges::find(rest, std::byte{'\n'});
    if (end == rest.end()) throw PickleError("the pickle is cut short", opcode_at_, true);
    std::string result = text(static_cast<std::uint64_t>(end - rest.begin()));
    ++at_;
    return result;
  }
  std::int64_t long1() {
    const std::size_t size = number<std::uint8_t>();
    if (size > sizeof(std::int64_t)) fail("a number does not fit into 64 bits");
    const std::span<const std::byte> digits = take(size);  // two's complement, least significant first
    std::uint64_t value =
        !digits.empty() && (digits.back() & std::byte{0x80}) != std::byte{} ? ~std::uint64_t{0} : 0;
    for (std::size_t i = size; i-- > 0;) value = (value << 8) | std::to_integer<std::uint64_t>(digits[i]);
    return std::bit_cast<std::int64_t>(value);
  }
  void check_protocol(std::uint8_t protocol) const {
    if (protocol < 2 || protocol > 5) fail("pickle protocol " + std::to_string(protocol) + " is not read");
  }

  // --- objects, stack and memo

  PickleObject& push(Type type) {
    if (pickle_.objects.size() == kMaxObjects) fail("more than " + std::to_string(kMaxObjects) + " objects");
    stack_.push_back(pickle_.objects.size());
    pickle_.objects.emplace_back().type = type;
    return pickle_.objects.back();
  }
  void push_int(std::int64_t value) { push(Type::kInt).number = value; }
  void push_bool(bool value) { push(Type::kBool).number = value ? 1 : 0; }
  void push_text(std::uint64_t size) {
    std::string value = text(size);
    push(Type::kString).text = std::move(value);
  }
  void push_real() {
    std::uint64_t bits = 0;  // big-endian
    for (const std::byte b : take(8)) bits = (bits << 8) | std::to_integer<std::uint64_t>(b);
    push(Type::kFloat).real = std::bit_cast<double>(bits);
  }
  void push_tuple(std::vector<std::size_t> items) { push(Type::kTuple).items = std::move(items); }

  std::size_t floor() const { return marks_.empty() ? 0 : marks_.back(); }
  std::size_t top() const {
    if (stack_.size() <= floor()) fail("the stack is empty");
    return stack_.back();
  }
  std::vector<std::size_t> pop_from(std::size_t first) {
    const auto begin = stack_.begin() + static_cast<std::ptrdiff_t>(first);
    std::vector<std::size_t> items(begin, stack_.end());
    stack_.erase(begin, stack_.end());
    return items;
  }
  std::vector<std::size_t> pop_last(std::size_t count) {
    if (stack_.size() - floor() < count) fail("the stack is empty");
    return pop_from(stack_.size() - count);
  }
  std::vector<std::size_t> pop_to_mark() {
    if (marks_.empty()) fail("there is no mark");
    const std::size_t first = marks_.back();
    marks_.pop_back();
    return pop_from(first);
  }
  PickleObject& object(std::size_t index) { return pickle_.objects[index]; }
  void get(std::uint32_t slot) {
    const auto it = memo_.find(slot);
    if (it == memo_.end()) fail("memo entry " + std::to_string(slot) + " does not exist");
    stack_.push_back(it->second);
  }
  void put(std::uint32_t slot) { memo_[slot] = top(); }

  // --- containers

  void append(const std::vector<std::size_t>& items) {
    PickleObject& list = object(top());
    if (list.type == Type::kOpaque) return;  // what a list of its own kind holds
    if (list.type != Type::kList) fail("something is appended that is not a list");
    list.items.insert(list.items.end(), items.begin(), items.end());
  }
  void set_items(const std::vector<std::size_t>& items) {
    PickleObject& dict = object(top());
    if (dict.type == Type::kOpaque && items.size() % 2 == 0) return;
    if (dict.type != Type::kDict || items.size() % 2 != 0)
      fail("items are set in something that is not a dictionary");
    dict.items.insert(dict.items.end(), items.begin(), items.end());
  }
  void build() {
    const std::size_t state = pop_last(1)[0];
    PickleObject& target = object(top());
    if (target.type == Type::kOpaque && target.items.size() == 1) target.items.push_back(state);
    // An OrderedDict's attributes, such as a state_dict's _metadata, are of no use here.
    if (target.type != Type::kDict && target.type != Type::kOpaque)
      fail("attributes are set in something that is not a dictionary");
  }
  void stop() {
    if (!marks_.empty() || stack_.size() != 1)
      fail("the pickle ends with " + std::to_string(stack_.size()) + " objects");
    pickle_.root = stack_.back();
  }

  // --- globals

  void push_global(const std::string& module, const std::string& name) {
    if (module.size() + name.size() > kMaxGlobal) fail("a global's name is too long");
    push(Type::kGlobal).text = module + " " + name;
  }
  void global_of_lines() {
    const std::string module = line();
    push_global(module, line());
  }
  void stack_global() {
    const std::vector<std::size_t> names = pop_last(2);
    if (object(names[0]).type != Type::kString || object(names[1]).type != Type::kString)
      fail("a global's name is not a text");
    push_global(object(names[0]).text, object(names[1]).text);
  }
  void reduce() {
    const std::vector<std::size_t> call = pop_last(2);
    const PickleObject& callee = object(call[0]);
    if ((callee.type != Type::kGlobal && callee.type != Type::kOpaque) ||
        object(call[1]).type != Type::kTuple)
      fail("something is called that is not a function");
    if (std::ranges::find(kFunctions, std::string_view(callee.text)) == kFunctions.end())
      return push_opaque(call[0]);
    if (object(call[1]).items.size() > kMaxArguments)
      fail("\"" + callee.text + "\" is not called as expected");
    const std::string function = callee.text;
    const std::vector<std::size_t> arguments = object(call[1]).items;
    if (function == "collections OrderedDict") return ordered_dict(arguments);
    if (function == "torch._utils _rebuild_tensor" && arguments.size() == 4) return rebuild_tensor(arguments);
    if (function == "torch._utils _rebuild_tensor_v2" && (arguments.size() == 6 || arguments.size() == 7))
      return rebuild_tensor(arguments);
    if (function.starts_with("torch._utils _rebuild_parameter") && arguments.size() >= 3 &&
        object(arguments[0]).type == Type::kTensor)
      return stack_.push_back(arguments[0]);
    if (arguments.size() == 1 && (function == "torch Size" || function.ends_with(" set")))
      return stack_.push_back(arguments[0]);
    fail("\"" + printable(function) + "\" is not called as expected");
  }
  /// What a class or function that is not understood would make. It is not asked to.
  void push_opaque(std::size_t maker) {
    while (object(maker).type == Type::kOpaque) maker = object(maker).items[0];
    if (object(maker).type != Type::kGlobal) fail("something is called that is not a function");
    push(Type::kOpaque).items = {maker};
  }
  void ordered_dict(const std::vector<std::size_t>& arguments) {
    std::vector<std::size_t> items;
    if (arguments.size() > 1) fail("OrderedDict is not called as expected");
    if (arguments.size() == 1) {
      for (const std::size_t pair : object(arguments[0]).items) {
        if (object(pair).items.size() != 2 || ++copied_pairs_ > kMaxObjects)
          fail("OrderedDict is not called as expected");
        items.insert(items.end(), object(pair).items.begin(), object(pair).items.end());
      }
    }
    push(Type::kDict).items = std::move(items);
  }

  // --- storages and tensors

  std::uint64_t natural(std::size_t index, const char* what) {
    const PickleObject& o = object(index);
    if (o.type != Type::kInt) fail(std::string(what) + " is not a whole number");
    if (o.number < 0) fail(std::string(what) + " is negative: " + std::to_string(o.number));
    return static_cast<std::uint64_t>(o.number);
  }
  std::vector<std::uint64_t> naturals(std::size_t index, const char* what) {
    const PickleObject& o = object(index);
    if (o.type != Type::kTuple && o.type != Type::kList) fail(std::string(what) + " is not a tuple");
    if (o.items.size() > static_cast<std::size_t>(Shape::kMaxRank))
      fail("a tensor has more than five dimensions");
    std::vector<std::uint64_t> values;
    values.reserve(o.items.size());
    for (const std::size_t item : o.items) values.push_back(natural(item, what));
    return values;
  }

  // ("module", class, file, source): how streams write the class of a whole network
  bool is_module_class(std::size_t id) {
    const std::vector<std::size_t>& fields = object(id).items;
    return object(id).type == Type::kTuple && fields.size() == 4 && object(fields[0]).text == "module" &&
           object(fields[1]).type == Type::kGlobal;
  }
  // ("storage", class, key, device, element count[, None or (key of a view, offset, count)])
  void persistent_id() {
    const std::size_t id = pop_last(1)[0];
    if (is_module_class(id)) return stack_.push_back(object(id).items[1]);
    if (object(id).type != Type::kTuple || object(id).items.size() < 5 || object(id).items.size() > 6)
      fail("a persistent id is no storage");
    const std::vector<std::size_t> fields = object(id).items;
    if (object(fields[0]).text != "storage" || object(fields[1]).type != Type::kGlobal ||
        object(fields[2]).type != Type::kString || object(fields[2]).text.size() > kMaxKey)
      fail("a persistent id is no storage");
    const std::optional<DType> dtype = storage_dtype(object(fields[1]).text);
    if (!dtype) fail("\"" + printable(object(fields[1]).text) + "\" is no storage class");
    const std::string key = object(fields[2]).text;
    const std::uint64_t count = natural(fields[4], "a storage's size");
    if (count >> 48 != 0) fail("a storage's size is too large: " + std::to_string(count));
    const auto [it, fresh] = storages_.emplace(key, pickle_.storages.size());
    if (fresh) pickle_.storages.push_back({key, *dtype, count});
    const PickleStorage& known = pickle_.storages[it->second];
    if (known.dtype != *dtype || known.count != count)
      fail("storage " + printable(key) + " is described in two ways");
    std::uint64_t offset = 0;
    if (fields.size() == 6 && object(fields[5]).type != Type::kNone)
      offset = offset_of_view(fields[5], count);
    PickleObject& storage = push(Type::kStorage);
    storage.number = static_cast<std::int64_t>(it->second);
    storage.items = {static_cast<std::size_t>(offset)};
  }
  std::uint64_t offset_of_view(std::size_t view, std::uint64_t count) {
    if (object(view).type != Type::kTuple || object(view).items.size() != 3)
      fail("a storage's view is not a triple");
    const std::uint64_t offset = natural(object(view).items[1], "a storage view's offset");
    const std::uint64_t size = natural(object(view).items[2], "a storage view's size");
    if (offset > count || size > count - offset) fail("a storage's view reaches past its end");
    return offset;
  }

  // (storage, offset, sizes, strides, ...): what follows concerns gradients
  void rebuild_tensor(const std::vector<std::size_t>& arguments) {
    if (object(arguments[0]).type != Type::kStorage) fail("a tensor has no storage");
    PickleTensor tensor;
    tensor.storage = static_cast<std::size_t>(object(arguments[0]).number);
    tensor.offset = natural(arguments[1], "a tensor's offset");
    tensor.sizes = naturals(arguments[2], "a tensor's size");
    tensor.strides = naturals(arguments[3], "a tensor's stride");
    const PickleStorage& storage = pickle_.storages[tensor.storage];
    if (__builtin_add_overflow(tensor.offset, object(arguments[0]).items[0], &tensor.offset) ||
        tensor.sizes.size() != tensor.strides.size() || !fits(tensor, storage.count))
      fail("a tensor reaches past the end of storage " + printable(storage.key) + ", which has " +
           std::to_string(storage.count) + " elements");
    push(Type::kTensor).number = static_cast<std::int64_t>(pickle_.tensors.size());
    pickle_.tensors.push_back(std::move(tensor));
  }
  /// True if the last element lies within the storage. A tensor without elements always fits.
  static bool fits(const PickleTensor& tensor, std::uint64_t count) {
    std::uint64_t last = tensor.offset;
    for (std::size_t axis = 0; axis < tensor.sizes.size(); ++axis) {
      std::uint64_t reach = 0;
      if (tensor.sizes[axis] == 0) return true;
      if (__builtin_mul_overflow(tensor.sizes[axis] - 1, tensor.strides[axis], &reach) ||
          __builtin_add_overflow(last, reach, &last))
        return false;
    }
    return last < count;
  }

  std::span<const std::byte> bytes_;
  std::size_t at_ = 0;
  std::size_t opcode_at_ = 0;
  std::vector<std::size_t> stack_;
  std::vector<std::size_t> marks_;
  std::unordered_map<std::uint32_t, std::size_t> memo_;
  std::map<std::string, std::size_t> storages_;
  std::size_t copied_pairs_ =
      0;  // by OrderedDict(list), the one call that copies: a list may be used again and again
  Pickle pickle_;
};

}  // namespace

Pickle read_pickle(std::span<const std::byte> bytes) { return Machine(bytes).run(); }

std::string class_name(const Pickle& pickle, const PickleObject& opaque) {
  std::string name = pickle.objects[opaque.items[0]].text;
  std::ranges::replace(name, ' ', '.');
  return printable(std::move(name));
}

}  // namespace slide
