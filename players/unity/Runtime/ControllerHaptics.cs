// SPDX-License-Identifier: MIT
using UnityEngine;
using UnityEngine.XR;

namespace Hfx.Haptics
{
    /// <summary>
    /// Plays the vibrations of haptic players and bodies on the two controllers of a headset. An avatar that feels
    /// several clips has a haptic body for each.
    /// Actuators worn on the left go to the left controller, those on the right to the right one; of several the
    /// strongest counts.
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

        struct Pulse
        {
            public float Share, Seconds;
        }

        bool isLeftOn, isRightOn, isListening;

        public string Device { get { return device; } set { device = value ?? ""; } }

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
            Send(XRNode.LeftHand, new Pulse(), ref isLeftOn);
            Send(XRNode.RightHand, new Pulse(), ref isRightOn);
        }

        void OfPlayer(HapticPlayer source) { Play(); }

        void OfBody(HapticBody source) { Play(); }

        void Play()
        {
            Pulse left = new Pulse(), right = new Pulse();
            Add(player, ref left, ref right);
            Add(body, ref left, ref right);
            foreach (HapticPlayer each in furtherPlayers) Add(each, ref left, ref right);
            foreach (HapticBody each in furtherBodies) Add(each, ref left, ref right);
            Send(XRNode.LeftHand, left, ref isLeftOn);
            Send(XRNode.RightHand, right, ref isRightOn);
        }

        void Add(HapticPlayer of, ref Pulse left, ref Pulse right)
        {
            if (of != null && of.Values != null) Add(of.Clip, of.Values, ref left, ref right);
        }

        void Add(HapticBody of, ref Pulse left, ref Pulse right)
        {
            if (of != null && of.Values != null) Add(of.Clip, of.Values, ref left, ref right);
        }

        void Add(HapticClip clip, float[] values, ref Pulse left, ref Pulse right)
        {
            foreach (Device each in clip.Devices)
            {
                if (!each.IsNamed(device)) continue;
                for (int k = each.FirstActuator; k < each.FirstActuator + each.Actuators; k++)
                {
                    Actuator actuator = clip.Actuators[k];
                    if (actuator.Modality != Modality.Vibration) continue;
                    Pulse pulse = new Pulse
                    {
                        Share = (float)(values[actuator.FirstColumn] / clip.Columns[actuator.FirstColumn].Highest),
                        Seconds = (float)each.DeadManSeconds,
                    };
                    if (actuator.Side == Side.Left && pulse.Share > left.Share) left = pulse;
                    if (actuator.Side == Side.Right && pulse.Share > right.Share) right = pulse;
                }
            }
        }

        static void Send(XRNode node, Pulse pulse, ref bool isOn)
        {
            if (pulse.Share <= 0.0f && !isOn) return;
            InputDevice controller = InputDevices.GetDeviceAtXRNode(node);
            isOn = pulse.Share > 0.0f;
            if (!controller.isValid) return;
            if (isOn) controller.SendHapticImpulse(0, pulse.Share, pulse.Seconds);
            else controller.StopHaptics();
        }
    }
}
