#pragma once

#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "runtime/op.h"

namespace slide::ops {

/// A kernel that calls the routines of one instruction-set level. `Routines` is a family's table of function
/// pointers, with a member `isa`; O the operator it computes. A derived class defines error_factor() and
/// compute().
template <typename O, typename Routines>
class LevelKernel : public Kernel {
 public:
  LevelKernel(std::string_view name, const Routines& routines) : name_(name), routines_(routines) {}

  [[nodiscard]] std::string_view name() const override { return name_; }
  [[nodiscard]] Isa isa() const override { return routines_.isa; }
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                              const Shape& /*output*/) const override {
    return true;
  }
  [[nodiscard]] double error_factor(const Op& op, std::span<const Shape> inputs) const override {
    return factor(static_cast<const O&>(op), inputs);
  }
  void run(const Op& op, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& call) const override {
    compute(static_cast<const O&>(op), inputs, output, call.scratch);
  }

 protected:
  [[nodiscard]] const Routines& routines() const noexcept { return routines_; }

 private:
  [[nodiscard]] virtual double factor(const O& op, std::span<const Shape> inputs) const = 0;
  virtual void compute(const O& op, std::span<const Tensor> inputs, Tensor& output,
                       std::span<std::byte> scratch) const = 0;

  std::string_view name_;
  const Routines& routines_;
};

/// One kernel of class K for each level's routines, in their order; they live as long as the program.
template <typename K, typename Routines>
class KernelList {
 public:
  KernelList(std::string_view name, std::span<const Routines* const> levels) {
    for (const Routines* routines : levels) {
      kernels_.push_back(std::make_unique<K>(name, *routines));
      pointers_.push_back(kernels_.back().get());
    }
  }
  [[nodiscard]] std::span<const Kernel* const> all() const noexcept { return pointers_; }

 private:
  std::vector<std::unique_ptr<K>> kernels_;
  std::vector<const Kernel*> pointers_;
};

}  // namespace slide::ops
