#include "weights_tools/checkpoint.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <set>
#include <string_view>
#include <utility>

#include "runtime/error.h"
#include "runtime/safetensors_header.h"
#include "weights_tools/strided.h"

namespace slide {
namespace {

using Type = PickleObject::Type;

// torch/serialization.py writes this number, as a pickle of its own, at the start of a stream.
constexpr std::array<unsigned char, 15> kStreamMagic = {0x80, 0x02, 0x8a, 0x0a, 0x6c, 0xfc, 0x9c, 0x46,
                                                        0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19, '.'};
constexpr std::array<unsigned char, 4> kZipMagic = {'P', 'K', 3, 4};
constexpr std::uint64_t kStreamVersion = 1001;
constexpr std::size_t kMaxPickle = std::size_t{32} << 20;
constexpr std::string_view kPickleName = "/data.pkl";

/// Where several dictionaries hold tensors, the network's weights are under one of these, the first
/// preferred.
constexpr std::array<std::string_view, 9> kUsualKeys = {
    "state_dict", "model_state_dict", "model", "params_ema", "params", "net", "netG", "G", "generator"};

Error bad(const std::string& problem, const std::string& remedy = "") {
  return Error(ErrorKind::kBadWeights, problem, remedy);
}

using NamedTensors = std::vector<std::pair<std::string, std::size_t>>;  // names and indices of tensors

/// The entry of that name in a dictionary, or null.
const PickleObject* entry(const Pickle& pickle, const PickleObject& dict, std::string_view name) {
  for (std::size_t i = 0; i + 1 < dict.items.size(); i += 2)
    if (pickle.objects[dict.items[i]].text == name) return &pickle.objects[dict.items[i + 1]];
  return nullptr;
}

/// The tensors of a dictionary, by its keys.
NamedTensors tensors_of_dict(const Pickle& pickle, const PickleObject& dict) {
  NamedTensors tensors;
  for (std::size_t i = 0; i + 1 < dict.items.size(); i += 2) {
    const PickleObject& name = pickle.objects[dict.items[i]];
    const PickleObject& value = pickle.objects[dict.items[i + 1]];
    if (name.type == Type::kString && name.text.size() <= 1024 && value.type == Type::kTensor)
      tensors.emplace_back(name.text, static_cast<std::size_t>(value.number));
  }
  return tensors;
}

/// Whole networks (torch.nn.Module): an object's attributes hold its parameters, its buffers and its parts,
/// each a dictionary; the names are those of its state_dict(). Parts may be shared and, in a hostile file,
/// hold each other: all the work done is bounded.
class ModuleWalk {
 public:
  explicit ModuleWalk(const Pickle& pickle) : pickle_(pickle) {}

  /// The tensors of a network; none if the object is something else.
  NamedTensors tensors(std::size_t object) {
    NamedTensors found;
    std::vector<std::pair<std::string, std::size_t>> rest = {{"", object}};
    while (!rest.empty()) {
      const auto [prefix, index] = std::move(rest.back());
      rest.pop_back();
      const PickleObject* state = state_of(index);
      if (state == nullptr || prefix.size() > 1024) continue;
      const PickleObject* passing = entry(pickle_, *state, "_non_persistent_buffers_set");
      for (const std::string_view kind : {"_parameters", "_buffers"})
        if (const PickleObject* own = entry(pickle_, *state, kind);
            own != nullptr && spend(own->items.size()))
          for (auto& [name, tensor] : tensors_of_dict(pickle_, *own))
            if (!among(passing, name)) found.emplace_back(prefix + name, tensor);
      const PickleObject* parts = entry(pickle_, *state, "_modules");
      if (!spend(parts->items.size())) break;
      for (std::size_t i = 0; i + 1 < parts->items.size(); i += 2)
        if (const PickleObject& name = pickle_.objects[parts->items[i]]; name.text.size() <= 1024)
          rest.emplace_back(prefix + name.text + ".", parts->items[i + 1]);
    }
    return found;
  }

 private:
  static constexpr std::size_t kMostSteps = 4'000'000;

  bool spend(std::size_t steps) {
    steps_ += steps + 1;
    return steps_ <= kMostSteps;
  }
  const PickleObject* state_of(std::size_t index) {
    const PickleObject& object = pickle_.objects[index];
    if (object.type != Type::kOpaque || object.items.size() < 2) return nullptr;
    const PickleObject& state = pickle_.objects[object.items[1]];
    if (state.type != Type::kDict || !spend(state.items.size())) return nullptr;
    return entry(pickle_, state, "_parameters") != nullptr && entry(pickle_, state, "_modules") != nullptr
               ? &state
               : nullptr;
  }
  bool among(const PickleObject* texts, std::string_view name) {
    return texts != nullptr && spend(texts->items.size()) &&
           std::ranges::any_of(texts->items, [&](std::size_t i) { return pickle_.objects[i].text == name; });
  }

  const Pickle& pickle_;
  std::size_t steps_ = 0;
};

/// A dictionary in which tensors lie directly under texts, or a whole network.
struct TensorSet {
  std::string path;
  NamedTensors tensors;
};

/// All of them, breadth first, the root's path being empty. Every object is looked at once.
std::vector<TensorSet> tensor_sets(const Pickle& pickle) {
  constexpr std::size_t kMaxDepth = 4;
  ModuleWalk modules(pickle);
  std::vector<TensorSet> found;
  std::set<std::size_t> seen = {pickle.root};
  std::vector<std::pair<std::string, std::size_t>> level = {{"", pickle.root}};
  for (std::size_t depth = 0; depth < kMaxDepth && !level.empty(); ++depth) {
    std::vector<std::pair<std::string, std::size_t>> next;
    for (const auto& [path, index] : level) {
      const PickleObject& object = pickle.objects[index];
      NamedTensors tensors =
          object.type == Type::kDict ? tensors_of_dict(pickle, object) : modules.tensors(index);
      if (!tensors.empty()) found.push_back({path, std::move(tensors)});
      if (object.type != Type::kDict) continue;
      for (std::size_t i = 0; i + 1 < object.items.size(); i += 2) {
        const PickleObject& name = pickle.objects[object.items[i]];
        if (name.type != Type::kString || name.text.size() > 256) continue;
        const Type type = pickle.objects[object.items[i + 1]].type;
        if ((type == Type::kDict || type == Type::kOpaque) && seen.insert(object.items[i + 1]).second)
          next.emplace_back(path.empty() ? name.text : path + "." + name.text, object.items[i + 1]);
      }
    }
    level = std::move(next);
  }
  return found;
}

/// What a checkpoint without tensors holds instead.
std::string objects_of(const Pickle& pickle) {
  constexpr std::size_t kShown = 3;
  std::vector<std::string> names;
  for (const PickleObject& object : pickle.objects) {
    if (object.type != Type::kOpaque) continue;
    std::string name = class_name(pickle, object);
    if (std::ranges::find(names, name) == names.end()) names.push_back(std::move(name));
    if (names.size() == kShown) break;
  }
  std::string text;
  for (const std::string& name : names) text.append(text.empty() ? ", but objects of " : ", ").append(name);
  return text;
}

std::string list_of(const std::vector<TensorSet>& sets) {
  constexpr std::size_t kShown = 8;
  std::string text;
  for (std::size_t i = 0; i < std::min(kShown, sets.size()); ++i)
    text.append(i > 0 ? ", " : "")
        .append(sets[i].path.empty() ? "\".\"" : "\"" + sets[i].path + "\"")
        .append(" (" + std::to_string(sets[i].tensors.size()) + " tensors)");
  return sets.size() > kShown ? text + " ..." : text;
}

TensorSet choose(const std::vector<TensorSet>& sets, const std::string& key, const std::string& file) {
  if (!key.empty()) {
    const auto found = std::ranges::find(sets, key == "." ? "" : key, &TensorSet::path);
    if (found == sets.end())
      throw bad(file + ": there are no tensors under \"" + key + "\", but under " + list_of(sets));
    return *found;
  }
  if (sets.size() == 1) return sets[0];
  for (const std::string_view usual : kUsualKeys)
    if (const auto found = std::ranges::find(sets, usual, &TensorSet::path); found != sets.end())
      return *found;
  throw bad(file + ": there are several sets of tensors: " + list_of(sets), "choose one with --key");
}

}  // namespace

std::optional<Checkpoint::Format> Checkpoint::recognise(const FileReader& file) {
  std::array<std::byte, kStreamMagic.size()> start{};
  const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(start.size(), file.size()));
  file.read(0, std::span(start).first(size));
  if (std::memcmp(start.data(), kZipMagic.data(), kZipMagic.size()) == 0) return Format::kZip;
  if (std::memcmp(start.data(), kStreamMagic.data(), kStreamMagic.size()) == 0) return Format::kStream;
  return std::nullopt;
}

Checkpoint::Checkpoint(std::unique_ptr<FileReader> file, Format format, const std::string& key)
    : file_(std::move(file)), format_(format) {
  if (format_ == Format::kZip)
    read_zip();
  else
    read_stream();
  select_tensors(key);
  check_total();
}

void Checkpoint::read_zip() {
  zip_ = std::make_unique<ZipArchive>(*file_);
  const ZipArchive::Member* main = nullptr;
  for (const ZipArchive::Member& member : zip_->members()) {
    const bool pickle = member.name.ends_with(kPickleName) &&
                        member.name.find('/') == member.name.size() - kPickleName.size();
    if (pickle && main != nullptr) throw bad(path() + ": the archive holds two checkpoints");
    if (pickle) main = &member;
  }
  if (main == nullptr)
    throw bad(path() + ": the zip archive holds no PyTorch checkpoint: there is no .../data.pkl in it");
  if (main->size > kMaxPickle) throw bad(path() + ": " + main->name + " is too large for a list of tensors");
  const std::string folder = main->name.substr(0, main->name.size() - kPickleName.size());
  if (zip_->find(folder + "/constants.pkl") != nullptr)
    throw bad(path() + ": this is a TorchScript program",
              "load it in Python with torch.jit.load() and save its state_dict()");
  if (const ZipArchive::Member* order = zip_->find(folder + "/byteorder");
      order != nullptr && order->size == 3)
    throw bad(path() + ": the checkpoint was written by a big-endian machine");  // "big", else "little"
  std::vector<std::byte> bytes(static_cast<std::size_t>(main->size));
  zip_->read(*main, bytes);
  try {
    pickle_ = slide::read_pickle(bytes);
  } catch (const PickleError& e) {
    throw bad(path() + ": " + e.what() + " (byte " + std::to_string(e.at) + " of " + main->name + ")",
              "only plain state_dicts of tensors are read, never code");
  }
  for (const PickleStorage& storage : pickle_.storages) {
    const ZipArchive::Member* member = zip_->find(folder + "/data/" + storage.key);
    if (member == nullptr)
      throw bad(path() + ": the data of storage " + storage.key + " is missing in the archive");
    if (member->size != storage.count * size_of(storage.dtype))
      throw bad(path() + ": " + member->name + " has " + std::to_string(member->size) + " bytes, " +
                std::to_string(storage.count) + " elements of " + std::string(name_of(storage.dtype)) +
                " are needed");
    members_.push_back(member);
  }
}

Pickle Checkpoint::read_pickle_at(std::uint64_t offset) const {
  // How long a pickle is shows only when it has been read.
  for (std::size_t window = std::size_t{64} << 10;; window *= 4) {
    const auto size = static_cast<std::size_t>(
        std::min<std::uint64_t>({window, kMaxPickle, file_->size() - std::min(offset, file_->size())}));
    try {
      return slide::read_pickle(file_->read(offset, size));
    } catch (const PickleError& e) {
      if (e.cut_short && size == window) continue;
      throw bad(path() + ": " + e.what() + " (byte " + std::to_string(offset + e.at) + ")",
                e.cut_short ? "" : "only plain state_dicts of tensors are read, never code");
    }
  }
}

void Checkpoint::read_stream() {
  std::uint64_t at = kStreamMagic.size();
  const auto next = [&] {
    Pickle pickle = read_pickle_at(at);
    at += pickle.consumed;
    return pickle;
  };
  const Pickle version = next();
  if (version.objects[version.root].number != kStreamVersion)
    throw bad(path() + ": the checkpoint's version is not " + std::to_string(kStreamVersion) + " (byte 15)");
  const Pickle system = next();
  const std::vector<std::size_t>& facts = system.objects[system.root].items;
  for (std::size_t i = 0; i + 1 < facts.size(); i += 2)
    if (system.objects[facts[i]].text == "little_endian" && system.objects[facts[i + 1]].number != 1)
      throw bad(path() + ": the checkpoint was written by a big-endian machine");
  pickle_ = next();
  const Pickle keys = next();

  // The data follows in the order of the keys: eight bytes of element count, then the elements.
  std::map<std::string_view, std::size_t> by_key;
  for (std::size_t i = 0; i < pickle_.storages.size(); ++i) by_key.emplace(pickle_.storages[i].key, i);
  offsets_.assign(pickle_.storages.size(), 0);
  for (const std::size_t item : keys.objects[keys.root].items) {
    const auto found = by_key.find(keys.objects[item].text);
    if (found == by_key.end() || offsets_[found->second] != 0)
      throw bad(path() + ": the list of storages does not match the tensors (byte " + std::to_string(at) +
                ")");
    const PickleStorage& storage = pickle_.storages[found->second];
    std::uint64_t count = 0;
    file_->read(at, std::as_writable_bytes(std::span(&count, 1)));
    if (count != storage.count)
      throw bad(path() + ": storage " + storage.key + " has " + std::to_string(count) + " elements, " +
                std::to_string(storage.count) + " are needed (byte " + std::to_string(at) + ")");
    at += sizeof count;
    offsets_[found->second] = at;
    const std::uint64_t bytes = storage.count * size_of(storage.dtype);
    if (bytes > file_->size() - at)
      throw bad(path() + ": the file is cut short: storage " + storage.key + " takes " +
                std::to_string(bytes) + " bytes (byte " + std::to_string(at) + "), the file ends at byte " +
                std::to_string(file_->size()));
    at += bytes;
  }
  if (std::ranges::count(offsets_, std::uint64_t{0}) != 0)
    throw bad(path() + ": the list of storages is not complete (byte " + std::to_string(at) + ")");
  if (at != file_->size())
    throw bad(path() + ": " + std::to_string(file_->size() - at) + " bytes after the last storage (byte " +
              std::to_string(at) + ")");
}

void Checkpoint::select_tensors(const std::string& key) {
  const std::vector<TensorSet> sets = tensor_sets(pickle_);
  if (sets.empty())
    throw bad(path() + ": the checkpoint holds no dictionary of tensors" + objects_of(pickle_),
              "save the network's state_dict() in Python; code in a checkpoint is never run");
  NamedTensors named = choose(sets, key, path()).tensors;

  // Tensors that share a storage come together, at the place of the first.
  std::vector<std::size_t> first(pickle_.storages.size(), named.size());
  const auto rank = [&](const auto& entry) -> std::size_t& {
    return first[pickle_.tensors[entry.second].storage];
  };
  for (std::size_t i = 0; i < named.size(); ++i) rank(named[i]) = std::min(rank(named[i]), i);
  std::ranges::stable_sort(named, {}, [&](const auto& entry) { return rank(entry); });
  std::set<std::string_view> seen;
  for (const auto& [name, view] : named) {
    if (!seen.insert(name).second) throw bad(path() + ": tensor " + name + " comes twice");
    add_tensor(name, view);
  }
}

void Checkpoint::add_tensor(const std::string& name, std::size_t view) {
  if (find_invalid_utf8(name) || has_control_character(name) || name.empty() || name.size() > 1024)
    throw bad(path() + ": the name of tensor " + std::to_string(tensors_.size()) + " is not a text");
  const PickleTensor& tensor = pickle_.tensors[view];
  std::uint64_t count = 1;
  std::vector<std::int64_t> extents;
  extents.reserve(tensor.sizes.size());
  for (const std::uint64_t size : tensor.sizes) {
    if (__builtin_mul_overflow(count, std::max<std::uint64_t>(size, 1), &count) || count >> 48 != 0)
      throw bad(path() + ": tensor " + name + ": the product of its dimensions is too large");
    extents.push_back(static_cast<std::int64_t>(size));
  }
  tensors_.push_back({name, pickle_.storages[tensor.storage].dtype, Shape(extents)});
  views_.push_back(view);
}

void Checkpoint::check_total() const {
  // Strides of zero, shared storages and compression let a small file stand for any amount of data.
  const std::uint64_t limit = 64 * file_->size() + (std::uint64_t{1} << 30);
  std::uint64_t tensors = 0;
  std::uint64_t storages = 0;
  const auto add = [&](std::uint64_t& total, std::uint64_t bytes) {
    total += bytes;
    if (bytes > limit || total > limit)
      throw bad(path() + ": the checkpoint has " + std::to_string(file_->size()) +
                " bytes, but its tensors would take more than " + std::to_string(limit));
  };
  for (const TensorInfo& info : tensors_) add(tensors, info.bytes());
  for (const PickleStorage& storage : pickle_.storages) add(storages, storage.count * size_of(storage.dtype));
}

std::span<const std::byte> Checkpoint::storage(std::size_t index) const {
  if (cached_ == index) return cache_;
  cached_.reset();
  const PickleStorage& storage = pickle_.storages[index];
  const auto bytes = static_cast<std::size_t>(storage.count * size_of(storage.dtype));
  if (bytes > cache_.capacity())
    std::vector<std::byte>().swap(cache_);  // lest the old and the new be in memory together
  cache_.resize(bytes);
  if (format_ == Format::kZip)
    zip_->read(*members_[index], cache_);
  else
    file_->read(offsets_[index], cache_);
  cached_ = index;
  return cache_;
}

void Checkpoint::for_each_block(std::size_t i, const Take& take) const {
  if (tensors_[i].bytes() == 0) return;
  const PickleTensor& view = pickle_.tensors[views_[i]];
  for_each_strided_block(storage(view.storage), size_of(tensors_[i].dtype), view, take);
}

}  // namespace slide
