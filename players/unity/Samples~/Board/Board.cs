// SPDX-License-Identifier: MIT
using UnityEngine;

namespace Hfx.Haptics.Samples
{
    /// <summary>
    /// The map paper's board of 4 x 4 squares of four materials. Add it to an empty object in front of the main
    /// camera, choose the clip beside this file, and press Play: drag over it with a mouse, or with a finger on an
    /// Android phone, which vibrates; so does a gamepad.
    /// </summary>
    [AddComponentMenu("Haptics/Samples/Board")]
    public sealed class Board : MonoBehaviour
    {
        const float Side = 0.25f, Gap = 0.01f; // metres

        [SerializeField] HapticClipAsset clip;

        HapticSurface surface;
        Collider[] squares;
        string[] names;

        void Start()
        {
            surface = gameObject.AddComponent<HapticSurface>();
            surface.Asset = clip;
            surface.VibratesPhone = surface.VibratesGamepad = true;
            Surface[] all = clip.Clip.Surfaces;
            squares = new Collider[all.Length];
            names = new string[all.Length];
            for (int k = 0; k < all.Length; k++)
            {
                // A name is that of a material, and row and column from 1: "Wood 14".
                names[k] = all[k].Name;
                int row = names[k][names[k].Length - 2] - '1', column = names[k][names[k].Length - 1] - '1';
                GameObject square = GameObject.CreatePrimitive(PrimitiveType.Quad);
                square.name = names[k];
                square.transform.SetParent(transform, false);
                square.transform.localPosition = Side * new Vector3(column - 1.5f, 1.5f - row, 0.0f);
                square.transform.localScale = (Side - Gap) * Vector3.one;
                square.GetComponent<Renderer>().material.color = Colour(names[k]);
                squares[k] = square.GetComponent<Collider>();
            }
        }

        void Update()
        {
            Vector2 pointer;
            RaycastHit hit;
            if (IsPressed(out pointer) && Physics.Raycast(Camera.main.ScreenPointToRay(pointer), out hit))
            {
                for (int k = 0; k < squares.Length; k++)
                {
                    if (hit.collider != squares[k]) continue;
                    surface.Surface = names[k];
                    surface.Touch(hit);
                    return;
                }
            }
            surface.Release();
        }

        static bool IsPressed(out Vector2 place)
        {
#if HFX_INPUT_SYSTEM && ENABLE_INPUT_SYSTEM
            UnityEngine.InputSystem.Pointer pointer = UnityEngine.InputSystem.Pointer.current;
            place = pointer != null ? pointer.position.ReadValue() : new Vector2();
            return pointer != null && pointer.press.isPressed;
#else
            place = Input.mousePosition;
            return Input.GetMouseButton(0);
#endif
        }

        static Color Colour(string name)
        {
            if (name.StartsWith("Gravel")) return new Color(0.45f, 0.43f, 0.4f);
            if (name.StartsWith("Metal")) return new Color(0.6f, 0.65f, 0.7f);
            return name.StartsWith("Fabric") ? new Color(0.3f, 0.35f, 0.6f) : new Color(0.6f, 0.42f, 0.25f);
        }
    }
}
