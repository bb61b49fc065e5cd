// SPDX-License-Identifier: MIT
using System;
using UnityEngine;
using UnityEngine.XR;

namespace Hfx.Haptics
{
    /// <summary>
    /// A haptic surface of a clip: vibrates under a finger, a pointer or a controller that moves over it. Each frame
    /// of a touch call one of the Touch methods or <see cref="Point"/>; <see cref="Release"/> as it ends. It is
    /// silent while the game is paused or has lost its focus. Makes no garbage.
    /// </summary>
    [AddComponentMenu("Haptics/Haptic Surface")]
    public sealed class HapticSurface : MonoBehaviour
    {
        const float HoldSeconds = 0.05f; // pointers are slower than frames
        const float PulseSeconds = 0.1f; // ends by itself, should the game hang
        const float PhoneSeconds = 0.05f;

        public enum Hand { None, Left, Right }

        [SerializeField] HapticClipAsset clip;
        /// <summary>Name of the surface in the clip; empty: its first.</summary>
        [SerializeField] string surface = "";
        /// <summary>How often the map stands side by side from 0 to 1 of a place, or in an area of the screen.</summary>
        [SerializeField] Vector2 repeat = new Vector2(1.0f, 1.0f);
        [SerializeField, Range(0.0f, 4.0f)] float gain = 1.0f;
        /// <summary>The controller of a headset that plays.</summary>
        [SerializeField] Hand controller = Hand.None;
        /// <summary>The current gamepad plays; needs the Input System package.</summary>
        [SerializeField] bool vibratesGamepad;
        /// <summary>The Android phone that runs the game plays; needs its permission VIBRATE.</summary>
        [SerializeField] bool vibratesPhone;
        /// <summary>Peak amplitude of the outputs at full strength, m/s²: 1.3 g, as of the map paper's phone.</summary>
        [SerializeField] float fullAmplitude = 12.75f;

        SurfaceStroke stroke;
        float waited = 1.0f, phoneWait;
        bool isOn, isAway, isKnown;

        /// <summary>Each frame of a touch, and once more as it ends.</summary>
        public event Action<HapticSurface> Felt;

        /// <summary>Peak amplitude, m/s².</summary>
        public float Amplitude { get; private set; }
        public float FrequencyHz { get; private set; }
        /// <summary>0 (rough) to 1.</summary>
        public float Sharpness { get; private set; }
        public Vector2 Repeat { get { return repeat; } set { repeat = value; } }
        public float Gain { get { return gain; } set { gain = value; } }
        public Hand Controller { get { return controller; } set { controller = value; } }
        public bool VibratesGamepad { get { return vibratesGamepad; } set { vibratesGamepad = value; } }
        public bool VibratesPhone { get { return vibratesPhone; } set { vibratesPhone = value; } }
        public HapticClip Clip { get { return clip != null ? clip.Clip : null; } }

        public HapticClipAsset Asset
        {
            get { return clip; }
            set
            {
                Release();
                clip = value;
                stroke = null;
                isKnown = false;
            }
        }

        /// <summary>Name of the surface; another one begins a new touch.</summary>
        public string Surface
        {
            get { return surface; }
            set
            {
                if (surface != value) isKnown = false;
                surface = value ?? "";
            }
        }

        /// <summary>
        /// Something touches the surface at shares of the map's width and height from its lower left corner.
        /// </summary>
        /// <param name="speed">Relative to the material, mm/s; below 0: that of the path.</param>
        public void Touch(Vector2 uv, float speed = -1.0f)
        {
            Move(uv.x * repeat.x, uv.y * repeat.y, speed);
        }

        void Move(float u, float v, float speed)
        {
            if (!Prepare() || isAway) return;
            stroke.Feel(u, v, speed, waited);
            // Several places in one frame: the strongest of them plays.
            if (waited > 0.0f || stroke.Amplitude >= Amplitude)
            {
                Amplitude = stroke.Amplitude;
                FrequencyHz = stroke.FrequencyHz;
                Sharpness = stroke.Sharpness;
            }
            waited = 0.0f;
        }

        /// <summary>
        /// A ray of the game has hit the object: its collider has to be a mesh collider. The map is to scale, as in
        /// Blender, where the object of the scene has texture coordinates.
        /// </summary>
        public void Touch(RaycastHit hit)
        {
            if (!Prepare()) return;
            Surface found = stroke.Surface;
            Vector2 uv = hit.textureCoord;
            if (found.UvWidthMm > 0.0f && found.UvHeightMm > 0.0f)
                Move(uv.x * found.UvWidthMm / found.WidthMm, uv.y * found.UvHeightMm / found.HeightMm, -1.0f);
            else Touch(uv);
        }

        /// <summary>A pointer touches an area of the screen, in its coordinates; beyond it, it releases.</summary>
        public void Touch(Vector2 point, Rect area)
        {
            if (area.Contains(point)) Touch(new Vector2((point.x - area.x) / area.width, (point.y - area.y) / area.height));
            else Release();
        }

        /// <summary>A pointer's ray touches a mesh collider, or releases where it misses it.</summary>
        public bool Point(Ray ray, Collider collider, float distance = 100.0f)
        {
            RaycastHit hit;
            bool hits = collider.Raycast(ray, out hit, distance);
            if (hits) Touch(hit);
            else Release();
            return hits;
        }

        /// <summary>Ends the touch, in silence.</summary>
        public void Release()
        {
            if (stroke != null) stroke.Lift();
            Amplitude = 0.0f;
            if (isOn) Play();
        }

        void OnDisable() { Release(); }

        void OnApplicationFocus(bool hasFocus)
        {
            isAway = !hasFocus;
            if (isAway) Release();
        }

        void OnApplicationPause(bool pause)
        {
            isAway = pause;
            if (isAway) Release();
        }

        void LateUpdate()
        {
            if (isAway) return;
            phoneWait -= Time.deltaTime;
            if (Time.timeScale == 0.0f || waited > HoldSeconds) Amplitude = 0.0f;
            if (waited == 0.0f || isOn) Play();
            waited += Time.deltaTime;
        }

        bool Prepare()
        {
            if (clip == null) return false;
            if (stroke == null) stroke = new SurfaceStroke(clip.Clip);
            if (isKnown) return stroke.Surface != null;
            isKnown = true;
            Surface found = null;
            Surface[] all = clip.Clip.Surfaces;
            for (int k = 0; k < all.Length && found == null; k++)
                if (surface.Length == 0 || all[k].Name == surface) found = all[k];
            stroke.Surface = found;
            if (found != null) return true;
            Amplitude = 0.0f;
            Debug.LogError("The haptic clip has no surface '" + surface + "'.", this);
            return false;
        }

        void Play()
        {
            float share = Mathf.Min(Amplitude * gain / fullAmplitude, 1.0f);
            if (controller != Hand.None && (share > 0.0f || isOn)) Pulse(share);
#if HFX_INPUT_SYSTEM
            // The large motor of a gamepad is the lower one.
            UnityEngine.InputSystem.Gamepad gamepad = UnityEngine.InputSystem.Gamepad.current;
            if (vibratesGamepad && gamepad != null && (share > 0.0f || isOn))
                gamepad.SetMotorSpeeds(share * (1.0f - Sharpness), share * Sharpness);
#endif
            if (vibratesPhone && share > 0.0f && phoneWait <= 0.0f)
            {
                PhoneVibration.Play(share);
                phoneWait = PhoneSeconds;
            }
            isOn = share > 0.0f;
            if (Felt != null) Felt(this);
        }

        void Pulse(float share)
        {
            InputDevice device = InputDevices.GetDeviceAtXRNode(controller == Hand.Left ? XRNode.LeftHand : XRNode.RightHand);
            if (!device.isValid) return;
            if (share > 0.0f) device.SendHapticImpulse(0, share, PulseSeconds);
            else device.StopHaptics();
        }
    }
}
