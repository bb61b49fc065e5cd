// SPDX-License-Identifier: MIT
// As much of Unreal's types as players/cpp/unreal uses, so that it can be compiled without Unreal.
#pragma once
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

using uint8 = unsigned char;
using int32 = int;
using TCHAR = char16_t;
#define TEXT(text) u##text

inline std::string utf8_of(const TCHAR *text) {
  std::string found;
  for (; *text; text++) {
    if (*text < 0x80) found += static_cast<char>(*text);
    else if (*text < 0x800) {
      found += static_cast<char>(0xC0 | *text >> 6);
      found += static_cast<char>(0x80 | (*text & 0x3F));
    }
  }
  return found;
}
#define TCHAR_TO_UTF8(text) utf8_of(text).c_str()
#define UTF8_TO_TCHAR(text) std::u16string(text, text + std::char_traits<char>::length(text)).c_str()

class FString {
 public:
  FString(const TCHAR *text = TEXT("")) : text_(text) {}
  const TCHAR *operator*() const { return text_.c_str(); }

 private:
  std::u16string text_;
};

template <class T>
class TArray {
 public:
  int32 Num() const { return static_cast<int32>(items_.size()); }
  void SetNum(int32 count) { items_.resize(static_cast<size_t>(count)); }
  const T *GetData() const { return items_.data(); }
  void Add(const T &item) { items_.push_back(item); }
  T &operator[](int32 index) { return items_[static_cast<size_t>(index)]; }
  const T &operator[](int32 index) const { return items_[static_cast<size_t>(index)]; }

 private:
  std::vector<T> items_;
};

#define DECLARE_DYNAMIC_MULTICAST_DELEGATE_OneParam(name, type, parameter) \
  struct name { \
    std::function<void(type)> bound; \
    void Broadcast(type values) { \
      if (bound) bound(values); \
    } \
  }
#define HFXHAPTICS_API
#define UCLASS(...)
#define UPROPERTY(...)
#define UFUNCTION(...)
#define GENERATED_BODY() \
  using Super = UActorComponent; \
\
 public:
#define UE_LOG(category, verbosity, format, ...) std::puts("log: " #category)
