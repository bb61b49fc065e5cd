// SPDX-License-Identifier: MIT
// As much of Unity's classes as surfaces and their sample name.
using System;

namespace UnityEngine
{
    public struct Vector2
    {
        public float x, y;
        public Vector2(float x, float y) { this.x = x; this.y = y; }
        public static implicit operator Vector2(Vector3 of) { return new Vector2(of.x, of.y); }
        public static implicit operator Vector3(Vector2 of) { return new Vector3(of.x, of.y, 0.0f); }
    }
    public struct Rect
    {
        public float x, y, width, height;
        public Rect(float x, float y, float width, float height) { this.x = x; this.y = y; this.width = width; this.height = height; }
        public bool Contains(Vector2 at) { return at.x >= x && at.x < x + width && at.y >= y && at.y < y + height; }
    }
    public struct Ray { public Vector2 place; } // texture coordinates of the hit
    public struct RaycastHit { public Vector2 textureCoord { get; set; } public Collider collider { get; set; } }
    public class Collider : Component
    {
        public bool Raycast(Ray ray, out RaycastHit hit, float distance)
        {
            hit = new RaycastHit { textureCoord = ray.place, collider = this };
            return new Rect(0.0f, 0.0f, 1.0f, 1.0f).Contains(ray.place);
        }
    }
}

namespace UnityEngine
{
    public sealed class Material { public Color color; }
    public sealed class Renderer : Component { public readonly Material material = new Material(); }
    public sealed class Camera : Behaviour
    {
        public static readonly Camera main = new Camera();
        public Ray ScreenPointToRay(Vector3 point) { return new Ray { place = point }; }
    }
    public static class Physics
    {
        public static Collider before; // all rays hit it
        public static bool Raycast(Ray ray, out RaycastHit hit)
        {
            hit = new RaycastHit { textureCoord = ray.place, collider = before };
            return before != null;
        }
    }
    public static class Input
    {
        public static bool isPressed;
        public static Vector3 mousePosition;
        public static bool GetMouseButton(int button) { return isPressed; }
    }
}

namespace UnityEngine.InputSystem
{
    public sealed class Gamepad
    {
        public static readonly Gamepad current = new Gamepad();
        public float low, high;
        public void SetMotorSpeeds(float low, float high) { this.low = low; this.high = high; }
    }
}

#if UNITY_ANDROID
namespace UnityEngine
{
    public struct jvalue { public long j; public int i; public IntPtr l; }
    public static class AndroidJNI
    {
        public static int pulses;
        public static long strongest;
        public static IntPtr CallStaticObjectMethod(IntPtr of, IntPtr method, jvalue[] given)
        {
            strongest = Math.Max(strongest, given[1].i);
            return new IntPtr(1);
        }
        public static void CallVoidMethod(IntPtr on, IntPtr method, jvalue[] given) { pulses++; }
        public static void DeleteLocalRef(IntPtr of) { }
        public static IntPtr NewGlobalRef(IntPtr of) { return new IntPtr(1); }
        public static IntPtr GetStaticMethodID(IntPtr of, string name, string signature) { return new IntPtr(1); }
        public static IntPtr GetMethodID(IntPtr of, string name, string signature) { return new IntPtr(1); }
    }
    public class AndroidJavaObject : IDisposable
    {
        public T Call<T>(string method, params object[] given) where T : new() { return new T(); }
        public T GetStatic<T>(string field) where T : new() { return new T(); }
        public IntPtr GetRawClass() { return new IntPtr(1); }
        public IntPtr GetRawObject() { return new IntPtr(1); }
        public void Dispose() { }
    }
    public sealed class AndroidJavaClass : AndroidJavaObject { public AndroidJavaClass(string name) { } }
}
#endif
