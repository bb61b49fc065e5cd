// SPDX-License-Identifier: MIT
// As much of Unity's classes as the package names, so that it can be compiled without an editor.
using System;
using System.Collections.Generic;

namespace UnityEngine
{
    public class Object
    {
        public string name = "";
        public static T[] FindObjectsOfType<T>()
        {
            List<T> found = new List<T>();
            foreach (GameObject each in GameObject.all)
                foreach (Component component in each.components) if (component is T) found.Add((T)(object)component);
            return found.ToArray();
        }
    }
    public class ScriptableObject : Object
    {
        public static T CreateInstance<T>() where T : ScriptableObject, new() { return new T(); }
    }
    public enum PrimitiveType { Cube = 3, Quad = 5 }
    public sealed class GameObject : Object
    {
        public static readonly List<GameObject> all = new List<GameObject>();
        public GameObject(string name = "")
        {
            this.name = name;
            all.Add(this);
        }
        public static GameObject Find(string name) { return all.Find(each => each.name == name); }
        public readonly Transform transform = new Transform();
        public readonly List<Component> components = new List<Component>();
        public T AddComponent<T>() where T : Component, new()
        {
            T made = new T { gameObject = this, transform = transform };
            components.Add(made);
            Call(made, "Awake");
            Call(made, "OnEnable");
            return made;
        }
        public T GetComponent<T>() where T : Component, new()
        {
            foreach (Component each in components) if (each is T) return (T)each;
            return AddComponent<T>(); // as of a primitive
        }
        public static GameObject CreatePrimitive(PrimitiveType type) { return new GameObject(); }
        public static void Call(object on, string method, params object[] given)
        {
            var found = on.GetType().GetMethod(method, System.Reflection.BindingFlags.Instance | System.Reflection.BindingFlags.NonPublic);
            if (found != null) found.Invoke(on, given);
        }
    }
    public class Component : Object
    {
        public Transform transform;
        public GameObject gameObject;
        public T[] GetComponentsInChildren<T>(bool includeInactive = false) { return (T[])(object)transform.all.ToArray(); }
        public T GetComponentInChildren<T>() where T : class { return null; }
        public T GetComponent<T>() where T : Component { return (T)gameObject.components.Find(part => part is T); }
    }
    public class Behaviour : Component { }
    public class MonoBehaviour : Behaviour { }
    public class Transform : Component
    {
        public readonly List<Transform> all = new List<Transform>();
        public Transform parent;
        public Matrix4x4 localToWorldMatrix = Matrix4x4.identity;
        public Vector3 localPosition, localScale, position;
        public Quaternion rotation;
        public void SetParent(Transform parent, bool worldPositionStays)
        {
            this.parent = parent;
            parent.all.Add(this);
        }
        public Matrix4x4 worldToLocalMatrix { get { return localToWorldMatrix.inverse; } }
    }
    public sealed class Animator : Behaviour
    {
        public readonly Dictionary<HumanBodyBones, Transform> bones = new Dictionary<HumanBodyBones, Transform>();
        public bool isHuman { get { return true; } }
        public bool isActiveAndEnabled { get { return true; } }
        public float speed = 1.0f;
        public AnimatorStateInfo state;
        public AnimatorStateInfo GetCurrentAnimatorStateInfo(int layer) { return state; }
        public static int StringToHash(string name) { return name.GetHashCode(); }
        public Transform GetBoneTransform(HumanBodyBones bone)
        {
            Transform found;
            return bones.TryGetValue(bone, out found) ? found : null;
        }
    }
    public struct AnimatorStateInfo
    {
        public int shortNameHash;
        public float normalizedTime, length;
        public bool loop;
    }
    public enum HumanBodyBones { Hips, LeftUpperLeg, LeftHand, RightThumbProximal, RightThumbIntermediate, LastBone }
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public static Vector3 zero { get { return new Vector3(); } }
        public static Vector3 one { get { return new Vector3(1, 1, 1); } }
        public static Vector3 up { get { return new Vector3(0, 1, 0); } }
        public static Vector3 operator *(float by, Vector3 of) { return new Vector3(by * of.x, by * of.y, by * of.z); }
        public static Vector3 operator -(Vector3 of) { return -1.0f * of; }
        public static Vector3 operator +(Vector3 a, Vector3 b) { return new Vector3(a.x + b.x, a.y + b.y, a.z + b.z); }
        public static Vector3 operator -(Vector3 a, Vector3 b) { return a + -b; }
    }
    public struct Vector4
    {
        public float x, y, z, w;
        public Vector4(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
        public static implicit operator Vector3(Vector4 of) { return new Vector3(of.x, of.y, of.z); }
    }
    public struct Quaternion { public Vector3 x, y, z; } // the axes that it turns x, y and z to
    public struct Matrix4x4 // mRC: row R, column C
    {
        public float m00, m01, m02, m03, m10, m11, m12, m13, m20, m21, m22, m23, m30, m31, m32, m33;
        public static Matrix4x4 zero { get { return new Matrix4x4(); } }
        public static Matrix4x4 identity { get { return new Matrix4x4 { m00 = 1, m11 = 1, m22 = 1, m33 = 1 }; } }
        public Matrix4x4 inverse { get { return From(Inverse(Numbers())); } }
        public static Matrix4x4 operator *(Matrix4x4 a, Matrix4x4 b)
        {
            double[,] one = a.Numbers(), other = b.Numbers(), found = new double[4, 4];
            for (int i = 0; i < 64; i++) found[i / 16, i / 4 % 4] += one[i / 16, i % 4] * other[i % 4, i / 4 % 4];
            return From(found);
        }
        public void SetRow(int row, Vector4 to)
        {
            double[,] n = Numbers();
            n[row, 0] = to.x; n[row, 1] = to.y; n[row, 2] = to.z; n[row, 3] = to.w;
            this = From(n);
        }
        public Vector4 GetColumn(int k)
        {
            double[,] n = Numbers();
            return new Vector4((float)n[0, k], (float)n[1, k], (float)n[2, k], (float)n[3, k]);
        }
        public Vector3 lossyScale { get { return new Vector3(Length(0), Length(1), Length(2)); } }
        public Quaternion rotation { get { return new Quaternion { x = Axis(0), y = Axis(1), z = Axis(2) }; } }
        Vector3 Axis(int k) { return 1.0f / Length(k) * (Vector3)GetColumn(k); }
        float Length(int k)
        {
            Vector3 of = GetColumn(k);
            return (float)Math.Sqrt(of.x * of.x + of.y * of.y + of.z * of.z);
        }
        public static Matrix4x4 From(double[,] n)
        {
            return new Matrix4x4
            {
                m00 = (float)n[0, 0], m01 = (float)n[0, 1], m02 = (float)n[0, 2], m03 = (float)n[0, 3],
                m10 = (float)n[1, 0], m11 = (float)n[1, 1], m12 = (float)n[1, 2], m13 = (float)n[1, 3],
                m20 = (float)n[2, 0], m21 = (float)n[2, 1], m22 = (float)n[2, 2], m23 = (float)n[2, 3],
                m30 = (float)n[3, 0], m31 = (float)n[3, 1], m32 = (float)n[3, 2], m33 = (float)n[3, 3],
            };
        }
        double[,] Numbers()
        {
            return new double[,] { { m00, m01, m02, m03 }, { m10, m11, m12, m13 }, { m20, m21, m22, m23 }, { m30, m31, m32, m33 } };
        }
        static double[,] Inverse(double[,] of) // Gauss and Jordan
        {
            double[,] found = { { 1, 0, 0, 0 }, { 0, 1, 0, 0 }, { 0, 0, 1, 0 }, { 0, 0, 0, 1 } };
            for (int k = 0; k < 4; k++)
            {
                int pivot = k;
                for (int i = k; i < 4; i++) if (Math.Abs(of[i, k]) > Math.Abs(of[pivot, k])) pivot = i;
                for (int j = 0; j < 4; j++)
                {
                    double a = of[k, j], b = found[k, j];
                    of[k, j] = of[pivot, j]; of[pivot, j] = a;
                    found[k, j] = found[pivot, j]; found[pivot, j] = b;
                }
                double by = of[k, k];
                for (int j = 0; j < 4; j++) { of[k, j] /= by; found[k, j] /= by; }
                for (int i = 0; i < 4; i++)
                {
                    double times = i == k ? 0.0 : of[i, k];
                    for (int j = 0; j < 4; j++) { of[i, j] -= times * of[k, j]; found[i, j] -= times * found[k, j]; }
                }
            }
            return found;
        }
    }
    public struct Color { public Color(float r, float g, float b) { } }
    public static class Mathf
    {
        public const float PI = (float)Math.PI;
        public static float Cos(float angle) { return (float)Math.Cos(angle); }
        public static float Abs(float value) { return Math.Abs(value); }
        public static float Min(float one, float other) { return Math.Min(one, other); }
        public static float Max(float one, float other) { return Math.Max(one, other); }
        public static float Sin(float angle) { return (float)Math.Sin(angle); }
    }
    public static class Gizmos
    {
        public static Color color;
        public static Matrix4x4 matrix;
        public static void DrawLine(Vector3 from, Vector3 to) { }
        public static void DrawWireSphere(Vector3 centre, float radius) { }
        public static void DrawWireCube(Vector3 centre, Vector3 size) { }
    }
    public static class Time { public static float deltaTime = 1.0f / 60.0f, timeScale = 1.0f, unscaledTime; }
    public static class Application { public static bool isFocused = true; }
    public static class Debug
    {
        public static readonly List<string> messages = new List<string>();
        public static void LogError(object message, Object context) { messages.Add("error: " + message); }
        public static void LogWarning(object message, Object context) { messages.Add("warning: " + message); }
    }
    public sealed class DefaultExecutionOrder : Attribute
    {
        public readonly int order;
        public DefaultExecutionOrder(int order) { this.order = order; }
    }
    /// <summary>Frames as Unity's: <c>Update</c>, animators (with Animation Rigging), then <c>LateUpdate</c> by order.</summary>
    public static class Frames
    {
        public static void Play(List<MonoBehaviour> components, Action animate)
        {
            foreach (MonoBehaviour each in components) GameObject.Call(each, "Update");
            animate();
            components.Sort((one, other) => Order(one).CompareTo(Order(other)));
            foreach (MonoBehaviour each in components) GameObject.Call(each, "LateUpdate");
        }
        static int Order(MonoBehaviour of)
        {
            object[] found = of.GetType().GetCustomAttributes(typeof(DefaultExecutionOrder), true);
            return found.Length > 0 ? ((DefaultExecutionOrder)found[0]).order : 0;
        }
    }
    public sealed class SerializeField : Attribute { }
    public abstract class PropertyAttribute : Attribute { }
    public sealed class GUIContent { public string text = "Effect"; }
    public sealed class HideInInspectorAttribute : Attribute { }
    public sealed class AddComponentMenu : Attribute { public AddComponentMenu(string path) { } }
    public sealed class RangeAttribute : Attribute { public RangeAttribute(float lowest, float highest) { } }
}

namespace UnityEngine.XR
{
    public enum XRNode { LeftHand = 4, RightHand = 5 }
    public struct InputDevice
    {
        public static bool isConnected = true;
        public bool isValid { get { return isConnected; } }
        public static float amplitude, strongest;
        public bool SendHapticImpulse(uint channel, float amplitude, float duration = 1.0f)
        {
            InputDevice.amplitude = amplitude;
            strongest = Math.Max(strongest, amplitude);
            return true;
        }
        public void StopHaptics() { amplitude = 0.0f; }
    }
    public static class InputDevices { public static InputDevice GetDeviceAtXRNode(XRNode node) { return new InputDevice(); } }
}

namespace UnityEditor
{
    public sealed class CustomPropertyDrawer : Attribute { public CustomPropertyDrawer(Type of) { } }
    public abstract class PropertyDrawer
    {
        public abstract void OnGUI(UnityEngine.Rect position, SerializedProperty property, UnityEngine.GUIContent label);
    }
    public sealed class SerializedProperty { public string stringValue = ""; }
    public static class EditorGUI
    {
        public static int picked = -1;
        public static string[] shown;
        public static int Popup(UnityEngine.Rect position, string label, int chosen, string[] options)
        {
            shown = options;
            return picked < 0 ? chosen : picked;
        }
        public static bool PropertyField(UnityEngine.Rect position, SerializedProperty property, UnityEngine.GUIContent label)
        {
            shown = null;
            return false;
        }
    }
    public static class AssetDatabase
    {
        public static readonly Dictionary<string, UnityEngine.Object> assets = new Dictionary<string, UnityEngine.Object>();
        public static string[] FindAssets(string filter) { return new List<string>(assets.Keys).ToArray(); }
        public static string GUIDToAssetPath(string guid) { return guid; }
        public static T LoadAssetAtPath<T>(string path) where T : UnityEngine.Object { return assets[path] as T; }
    }
    public sealed class MenuItem : Attribute { public MenuItem(string path) { } }
    public sealed class MenuCommand { public UnityEngine.Object context; }
    public static class Undo
    {
        public static int steps;
        public static void SetCurrentGroupName(string name) { }
        public static void RegisterCreatedObjectUndo(UnityEngine.Object of, string name) { steps++; }
    }
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
