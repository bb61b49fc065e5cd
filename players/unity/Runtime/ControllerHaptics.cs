// SPDX-License-Identifier: MIT
using UnityEngine;
using UnityEngine.XR;

namespace Hfx.Haptics
{
    /// <summary>
    /// Plays the vibrations of haptic players and bodies on the two controllers of a headset, on a gamepad and on a
    /// phone. An avatar that feels several clips has a haptic body for each.
    /// Actuators worn on the left play on the left controller, those on the right on the right one. On a gamepad the
    /// left plays on the low-frequency motor, the right on the high-frequency motor, all others on both. Of several
    /// actuators the strongest counts.
    /// </summary>
    [AddComponentMenu("Haptics/Controller Haptics")]
    public sealed class ControllerHaptics : MonoBehaviour
    {
        [SerializeField] HapticPlayer player;
        [SerializeField] HapticBody body;
        [SerializeField] HapticPlayer[] furtherPlayers = new HapticPlayer[0];
        [SerializeField] HapticBody[] furtherBodies = new HapticBody[0];
        /// <summary>Id of a device in the clip (say oculus_touch, with or without its side); empty: all devices.</summary>
        [SerializeField] string device = "";
        /// <summary>The current gamepad plays while no controller of a headset is there; needs the Input System package.</summary>
        [SerializeField] bool vibratesGamepad = true;
        /// <summary>The Android phone that runs the game plays; needs its permission VIBRATE.</summary>
        [SerializeField] bool vibratesPhone;

        const float PhoneSeconds = 0.05f;

        struct Pulse
        {
            public float Share, Seconds;
        }

        Pulse left, right, elsewhere;
        float phoneTime;
        bool isLeftOn, isRightOn, isListening;
#if HFX_INPUT_SYSTEM
        bool isGamepadOn;
#endif

        public string Device { get { return device; } set { device = value ?? ""; } }
        public bool VibratesGamepad { get { return vibratesGamepad; } set { vibratesGamepad = value; } }
        public bool VibratesPhone { get { return vibratesPhone; } set { vibratesPhone = value; } }

        public HapticPlayer Player
        {
            get { return player; }
            set
            {
                bool wasListening = isListening;
                Listen(false);
                player = value;
                Listen(wasListening);
            }
        }

        public HapticBody Body
        {
            get { return body; }
            set
            {
                bool wasListening = isListening;
                Listen(false);
                body = value;
                Listen(wasListening);
            }
        }

        public HapticPlayer[] FurtherPlayers
        {
            get { return furtherPlayers; }
            set
            {
                bool wasListening = isListening;
                Listen(false);
                furtherPlayers = value ?? new HapticPlayer[0];
                Listen(wasListening);
            }
        }

        public HapticBody[] FurtherBodies
        {
            get { return furtherBodies; }
            set
            {
                bool wasListening = isListening;
                Listen(false);
                furtherBodies = value ?? new HapticBody[0];
                Listen(wasListening);
            }
        }

        /// <summary>The editor has added the component: chooses the player and the body of the same object.</summary>
        void Reset()
        {
            player = GetComponent<HapticPlayer>();
            body = GetComponent<HapticBody>();
        }

        void OnEnable() { Listen(true); }

        void Listen(bool listen)
        {
            if (listen == isListening) return;
            isListening = listen;
            Listen(player, listen);
            Listen(body, listen);
            foreach (HapticPlayer each in furtherPlayers) Listen(each, listen);
            foreach (HapticBody each in furtherBodies) Listen(each, listen);
        }

        void Listen(HapticPlayer to, bool listen)
        {
            if (to == null) return;
            to.ValuesChanged -= OfPlayer;
            if (listen) to.ValuesChanged += OfPlayer;
        }

        void Listen(HapticBody to, bool listen)
        {
            if (to == null) return;
            to.ValuesChanged -= OfBody;
            if (listen) to.ValuesChanged += OfBody;
        }

        void OnDisable()
        {
            Listen(false);
            left = right = elsewhere = new Pulse();
            Send();
        }

        void OfPlayer(HapticPlayer source) { Play(); }

        void OfBody(HapticBody source) { Play(); }

        void Play()
        {
            left = right = elsewhere = new Pulse();
            Add(player);
            Add(body);
            foreach (HapticPlayer source in furtherPlayers) Add(source);
            foreach (HapticBody source in furtherBodies) Add(source);
            Send();
        }

        void Add(HapticPlayer source)
        {
            if (source != null && source.Values != null) Add(source.Clip, source.Values);
        }

        void Add(HapticBody source)
        {
            if (source != null && source.Values != null) Add(source.Clip, source.Values);
        }

        void Add(HapticClip clip, float[] values)
        {
            foreach (Device worn in clip.Devices)
            {
                if (!worn.IsNamed(device)) continue;
                for (int k = worn.FirstActuator; k < worn.FirstActuator + worn.Actuators; k++)
                {
                    Actuator actuator = clip.Actuators[k];
                    if (actuator.Modality != Modality.Vibration) continue;
                    float share = (float)(values[actuator.FirstColumn] / clip.Columns[actuator.FirstColumn].Highest);
                    Pulse pulse = new Pulse { Share = share, Seconds = (float)worn.DeadManSeconds };
                    if (actuator.Side == Side.Left) left = Stronger(left, pulse);
                    else if (actuator.Side == Side.Right) right = Stronger(right, pulse);
                    else elsewhere = Stronger(elsewhere, pulse);
                }
            }
        }

        static Pulse Stronger(Pulse first, Pulse second) { return second.Share > first.Share ? second : first; }

        void Send()
        {
            bool hasControllers = Send(XRNode.LeftHand, left, ref isLeftOn);
            hasControllers = Send(XRNode.RightHand, right, ref isRightOn) || hasControllers;
#if HFX_INPUT_SYSTEM
            UnityEngine.InputSystem.Gamepad gamepad = UnityEngine.InputSystem.Gamepad.current;
            float low = 0.0f, high = 0.0f;
            if (vibratesGamepad && !hasControllers)
            {
                low = Stronger(left, elsewhere).Share;
                high = Stronger(right, elsewhere).Share;
            }
            bool isOn = low > 0.0f || high > 0.0f;
            if (gamepad != null && (isOn || isGamepadOn)) gamepad.SetMotorSpeeds(low, high);
            isGamepadOn = isOn;
#endif
            Pulse phone = Stronger(Stronger(left, right), elsewhere);
            if (!vibratesPhone || phone.Share <= 0.0f || Time.unscaledTime - phoneTime < PhoneSeconds) return;
            phoneTime = Time.unscaledTime;
            PhoneVibration.Play(phone.Share);
        }

        /// <summary>Whether there is a controller.</summary>
        static bool Send(XRNode node, Pulse pulse, ref bool isOn)
        {
            InputDevice controller = InputDevices.GetDeviceAtXRNode(node);
            bool wasOn = isOn;
            isOn = pulse.Share > 0.0f;
            if (!controller.isValid) return false;
            if (isOn) controller.SendHapticImpulse(0, pulse.Share, pulse.Seconds);
            else if (wasOn) controller.StopHaptics();
            return true;
        }
    }
}
