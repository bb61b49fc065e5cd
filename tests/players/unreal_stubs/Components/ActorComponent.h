// SPDX-License-Identifier: MIT
#pragma once
#include "../CoreMinimal.h"

enum ELevelTick { LEVELTICK_All };
struct FActorComponentTickFunction {
  bool bCanEverTick = false, bTickEvenWhenPaused = true;
};
namespace EEndPlayReason {
enum Type { Destroyed };
}
class UActorComponent {
 public:
  virtual ~UActorComponent() = default;
  virtual void BeginPlay() {}
  virtual void EndPlay(const EEndPlayReason::Type) {}
  virtual void TickComponent(float, ELevelTick, FActorComponentTickFunction *) {}
  FActorComponentTickFunction PrimaryComponentTick;
};
