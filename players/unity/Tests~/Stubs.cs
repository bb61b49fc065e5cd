// SPDX-License-Identifier: MIT
// As much of Unity's classes as the package names, so that it can be compiled without an editor.
using System;

namespace UnityEngine
{
    public class Object { }
    public class ScriptableObject : Object
    {
        public static T CreateInstance<T>() where T : ScriptableObject, new() { return new T(); }
    }
    public class MonoBehaviour : Object { }
    public static class Time { public static float deltaTime = 1.0f / 60.0f, timeScale = 1.0f; }
    public static class Debug { public static void LogError(object message, Object context) { Console.WriteLine(message); } }
    public sealed class SerializeField : Attribute { }
    public sealed class HideInInspectorAttribute : Attribute { }
    public sealed class AddComponentMenu : Attribute { public AddComponentMenu(string path) { } }
    public sealed class RangeAttribute : Attribute { public RangeAttribute(float lowest, float highest) { } }
}

namespace UnityEngine.XR
{
    public enum XRNode { LeftHand = 4, RightHand = 5 }
    public struct InputDevice
    {
        public bool isValid { get { return true; } }
        public bool SendHapticImpulse(uint channel, float amplitude, float duration = 1.0f) { return true; }
        public void StopHaptics() { }
    }
    public static class InputDevices { public static InputDevice GetDeviceAtXRNode(XRNode node) { return new InputDevice(); } }
}

namespace UnityEditor.AssetImporters
{
    public sealed class ScriptedImporterAttribute : Attribute { public ScriptedImporterAttribute(int version, string suffix) { } }
    public abstract class ScriptedImporter : UnityEngine.Object { public abstract void OnImportAsset(AssetImportContext context); }
    public sealed class AssetImportContext
    {
        public string assetPath { get { return ""; } }
        public void LogImportError(string message) { }
        public void AddObjectToAsset(string identifier, UnityEngine.Object asset) { }
        public void SetMainObject(UnityEngine.Object asset) { }
    }
}
