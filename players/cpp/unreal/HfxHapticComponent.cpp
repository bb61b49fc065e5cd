// SPDX-License-Identifier: MIT
#include "HfxHapticComponent.h"

UHfxHapticComponent::UHfxHapticComponent()
{
	PrimaryComponentTick.bCanEverTick = true;
	PrimaryComponentTick.bTickEvenWhenPaused = false;
}

void UHfxHapticComponent::BeginPlay()
{
	Super::BeginPlay();
	FString Error;
	if (Clip.Num() > 0 && !SetClip(Clip, Error))
	{
		UE_LOG(LogTemp, Error, TEXT("The haptic clip cannot be played: %s"), *Error);
	}
}

void UHfxHapticComponent::EndPlay(const EEndPlayReason::Type Reason)
{
	Stop();
	Super::EndPlay(Reason);
}

bool UHfxHapticComponent::SetClip(const TArray<uint8>& Bytes, FString& Error)
{
	Stop();
	const hfx::Clip Opened(std::vector<unsigned char>(Bytes.GetData(), Bytes.GetData() + Bytes.Num()));
	Error = Opened ? FString() : FString(UTF8_TO_TCHAR(Opened.error_text()));
	Player = hfx::Player(Opened);
	return static_cast<bool>(Opened);
}

bool UHfxHapticComponent::Play(const FString& Name)
{
	return Player.clip() && Player.play(std::string(TCHAR_TO_UTF8(*Name)));
}

void UHfxHapticComponent::SetLoop(bool bLoop)
{
	Player.loop(bLoop);
}

void UHfxHapticComponent::Stop()
{
	const bool bWasPlaying = Player.is_playing();
	Player.stop();
	if (bWasPlaying)
	{
		Send(Player.advance(0.0));
	}
}

int32 UHfxHapticComponent::FindColumn(const FString& Actuator, const FString& Parameter) const
{
	const std::string Id(TCHAR_TO_UTF8(*Actuator)), Name(TCHAR_TO_UTF8(*Parameter));
	const std::vector<hfx_actuator> Actuators = Player.clip().actuators();
	const std::vector<hfx_column> Columns = Player.clip().columns();
	for (size_t Index = 0; Index < Columns.size(); Index++)
	{
		if (Name == Columns[Index].parameter && Id == Actuators[Columns[Index].actuator].id)
		{
			return static_cast<int32>(Index);
		}
	}
	return -1;
}

void UHfxHapticComponent::TickComponent(float Seconds, ELevelTick Tick, FActorComponentTickFunction* Function)
{
	Super::TickComponent(Seconds, Tick, Function);
	if (!Player.is_playing())
	{
		return;
	}
	Player.gain(Gain);
	Send(Player.advance(Seconds));
	if (!Player.is_playing())
	{
		Send(Player.advance(0.0)); // neutral
	}
}

void UHfxHapticComponent::Send(const std::vector<float>& Numbers)
{
	Values.SetNum(static_cast<int32>(Numbers.size()));
	for (size_t Index = 0; Index < Numbers.size(); Index++)
	{
		Values[static_cast<int32>(Index)] = Numbers[Index];
	}
	OnValuesChanged.Broadcast(Values);
}
