// SPDX-License-Identifier: MIT
//
// A component that plays a haptic clip with its actor. Nobody has opened it in Unreal yet: it is
// compiled against stubs of Unreal's types.
#pragma once

#include "Components/ActorComponent.h"
#include "CoreMinimal.h"
#include "hfx_player.hpp"

#include "HfxHapticComponent.generated.h"

DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(FHfxValuesChanged, const TArray<float>&, Values);

UCLASS(ClassGroup = (Haptics), meta = (BlueprintSpawnableComponent))
class HFXHAPTICS_API UHfxHapticComponent : public UActorComponent
{
	GENERATED_BODY()

public:
	UHfxHapticComponent();

	/** Content of a .hfxclip file. */
	UPROPERTY(EditAnywhere, BlueprintReadOnly, Category = "Haptics")
	TArray<uint8> Clip;

	/** Scales all strengths; 1 as made. */
	UPROPERTY(EditAnywhere, BlueprintReadWrite, Category = "Haptics")
	float Gain = 1.0f;

	/** Each frame in which a clip plays, and once more when it ends: one value for each column, in its unit. */
	UPROPERTY(BlueprintAssignable, Category = "Haptics")
	FHfxValuesChanged OnValuesChanged;

	/** Opens another clip; false: it is none, and Error says why. */
	UFUNCTION(BlueprintCallable, Category = "Haptics")
	bool SetClip(const TArray<uint8>& Bytes, FString& Error);

	/** Begins with the whole clip (an empty name) or a named one; false: there is none of this name, or no clip. */
	UFUNCTION(BlueprintCallable, Category = "Haptics")
	bool Play(const FString& Name);

	/** Whether the whole clip, and what plays now, begins again at its end. */
	UFUNCTION(BlueprintCallable, Category = "Haptics")
	void SetLoop(bool bLoop);

	/** Neutral values at once, and an end. */
	UFUNCTION(BlueprintCallable, Category = "Haptics")
	void Stop();

	/** Column of an actuator, say "right_hand" and "amplitude_m_s2"; -1: there is none. */
	UFUNCTION(BlueprintCallable, Category = "Haptics")
	int32 FindColumn(const FString& Actuator, const FString& Parameter) const;

	virtual void BeginPlay() override;
	virtual void EndPlay(const EEndPlayReason::Type Reason) override;
	virtual void TickComponent(float Seconds, ELevelTick Tick, FActorComponentTickFunction* Function) override;

private:
	void Send(const std::vector<float>& Numbers);

	hfx::Player Player;
	TArray<float> Values;
};
