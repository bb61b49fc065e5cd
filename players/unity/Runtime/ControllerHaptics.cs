// SPDX-License-Identifier: MIT
using UnityEngine;
using UnityEngine.XR;

namespace Hfx.Haptics
{
    /// <summary>
    /// Plays the vibrations of a haptic player, of a haptic body, or of both on the two controllers of a headset.
    /// Actuators worn on the left go to the left controller, those on the right to the right one; of several the
    /// strongest counts.
    /// </summary>
    [AddComponentMenu("Haptics/Controller Haptics")]
    public sealed class ControllerHaptics : MonoBehaviour
    {
        [SerializeField] HapticPlayer player;
        [SerializeField] HapticBody body;
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

        void OnEnable() { Listen(true); }

        void Listen(bool listen)
        {
            if (player != null && isListening) player.ValuesChanged -= OfPlayer;
            if (body != null && isListening) body.ValuesChanged -= OfBody;
            isListening = listen;
            if (player != null && listen) player.ValuesChanged += OfPlayer;
            if (body != null && listen) body.ValuesChanged += OfBody;
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
            if (player != null && player.Values != null) Add(player.Clip, player.Values, ref left, ref right);
            if (body != null && body.Values != null) Add(body.Clip, body.Values, ref left, ref right);
            Send(XRNode.LeftHand, left, ref isLeftOn);
            Send(XRNode.RightHand, right, ref isRightOn);
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
